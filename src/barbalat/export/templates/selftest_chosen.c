#define CHOSEN ${count}
#define NUMBERS ${numbers}

/* Single samples, chosen because the simulated run does not reveal some faults of the arithmetic: see README.md. */
static const ${real} chosen_before[CHOSEN][NUMBERS] = {
${before_rows}};
static const ${real} chosen_measured[CHOSEN][${macro}_MEASURED] = {
${measured_rows}};
static const ${real} chosen_commands[CHOSEN][${macro}_COMMANDS] = {
${command_rows}};
${parameter_table}static const int chosen_freeze[CHOSEN] = { ${freeze} };
static const ${real} chosen_after[CHOSEN][NUMBERS] = {
${after_rows}};

static void test_chosen(void)
{
    int k;
    for (k = 0; k < CHOSEN; ++k) {
        ${name}_controller c;
        ${name}_input in;
        ${name}_output out;
        ${name}_init(&c);
${set}${set_parameters}        memcpy(in.${measured}, chosen_measured[k], sizeof in.${measured});
        memcpy(in.r, chosen_commands[k], sizeof in.r);
        in.sample_time = ${macro}_SAMPLE_TIME;
        in.freeze = chosen_freeze[k];
        require(${name}_step(&c, &in, &out) == ${macro}_OK && out.status == ${macro}_OK, "a chosen sample is refused");
        require(same(out.u, c.${u}, ${macro}_INPUTS)${estimates}${limited}, "the output differs from the state");
        require(${has}, "the state after a chosen sample differs");
    }
}

