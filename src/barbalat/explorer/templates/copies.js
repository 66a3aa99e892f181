// Writes a setting as a case file and as Python code; each simulates the same run, bit for bit.

// The shortest text that is read as the same number. A float keeps its decimal point.
export function numberText(value, whole) {
  const text = String(value);
  return !whole && Number.isInteger(value) && !text.includes("e") ? `${text}.0` : text;
}

export function caseFileOf(data, setting) {
  const values = [...setting.values, setting.tEnd, setting.dt, setting.delay];
  return data.case_file.map((part) => {
    if (typeof part === "string") return part;
    if ("projection" in part) return setting.projection[part.projection] === "on" ? "true" : "false";
    if ("solver" in part) return JSON.stringify(setting.solver);
    return numberText(values[part.number], data.numbers[part.number]?.whole ?? false);
  }).join("");
}

export function pythonOf(data, setting) {
  const tail = "results = simulate(case.problem, case.controllers, case.simulation)\n";
  if (data.case_file) {
    const text = caseFileOf(data, setting).replaceAll("\\", "\\\\").replaceAll('"""', '\\"\\"\\"');
    const imports = `from barbalat import simulate\nfrom barbalat.cases.load import parse_case\n`;
    if (!data.own_file) return `${imports}\ncase = parse_case("""\\\n${text}""")\n${tail}`;
    const own = `own=user_controllers.run(${JSON.stringify(data.own_file)})`;
    return `from barbalat.cases import user_controllers\n${imports}\ncase = parse_case("""\\\n${text}""", ${own})\n${tail}`;
  }
  const said = data.numbers.flatMap((number, i) => (
    setting.values[i] === number.value ? [] : [`    ${JSON.stringify(number.path)}: ${numberText(setting.values[i], number.whole)},`]
  ));
  said.push(`    "simulation.t_end": ${numberText(setting.tEnd, false)},`, `    "simulation.dt": ${numberText(setting.dt, false)},`);
  if (data.delay?.slider) said.push(`    "plant.input.delay": ${numberText(setting.delay, false)},`);
  const sides = data.toggles.map((i) => `${i}: ${setting.projection[i] === "on" ? "True" : "False"}`).join(", ");
  return (
    "from barbalat import simulate\n\n# page is what explore(problem, controllers, simulation) returned\ncase = page.at({\n"
    + `${said.join("\n")}\n}, projection={${sides}}, solver="${setting.solver}")\n${tail}`
  );
}
