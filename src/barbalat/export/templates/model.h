/*
 * ${origin}
 * The FMU ${identifier}: its variables and its step.
 */
#ifndef MODEL_H
#define MODEL_H

${include}
#define MODEL_TOKEN "${token}"
#define MODEL_REALS ${reals}u /* real variables, whose value references begin at 0 */
#define MODEL_TIME ${reals}u
#define MODEL_FIRST_WHOLE ${first_whole}u
#define MODEL_STEP ${step} /* [s] */
#define MODEL_TOLERANCE 1e-6 /* relative tolerance of a step size: above its rounding, below any intended difference */
#define MODEL_POINT_TOLERANCE 0.1 /* in steps: the rounding error of a master's sum of steps is smaller; a repeated step is off by 1 */
#define MODEL_MOST_STEPS 1e9 /* in one call; a larger number is an error */

typedef struct {
    double real[MODEL_REALS];
    int whole[2]; /* freeze and status; used only if the FMU contains a controller */
${parts}} model;

/* For each real variable: i: input; t: tunable; s: fixed after the start; n: calculated; T, S: as t and s, but must be
   positive. */
static const char model_settable[] = "${settable}";
/* For each other variable: b: Boolean; w: integer. */
static const char model_kinds[] = "${kinds}";
static const unsigned model_wholes = (unsigned)sizeof model_kinds - 1u;
enum { FMU_OK, FMU_WARNING, FMU_ERROR }; /* the result of a step */

void model_defaults(model *m);
const char *model_refused(const model *m); /* the bound that the parameters violate, or NULL */
void model_start(model *m);
int model_step(model *m);
void model_outputs(model *m);

#endif
