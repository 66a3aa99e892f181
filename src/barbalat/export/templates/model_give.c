static void give(const model *m, ${name}_plant_input *in)
{
${body}}

