"""selftest.c: the simulation's samples replayed, equal in every bit, and everything else that a flight computer relies on."""

from __future__ import annotations

import numpy as np

from barbalat.export.texts import Printed, filled, indented
from barbalat.lowering import c99
from barbalat.validate import Array


def selftest(printed: Printed) -> str:
    """The text of selftest.c."""
    contents = printed.contents
    vectors, layout = contents.vectors, contents.layout
    state = contents.measures_state
    estimates = vectors.states[:, list(layout.theta_hat.rows)]
    table = f"static const {printed.real} estimates[SAMPLES][{printed.macro}_ESTIMATES] = {{\n{_rows(printed, estimates)}}};\n"
    differ = f"\n            || !same(out.theta_hat, estimates[k], {printed.macro}_ESTIMATES)"
    return filled(
        "selftest.c",
        origin=printed.origin,
        guard=printed.guard,
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        samples=len(vectors.states),
        measured=printed.measured,
        measured_rows=_rows(printed, vectors.measured),
        command_rows=_rows(printed, vectors.commands),
        control_rows=_rows(printed, vectors.states[:, list(layout.u.rows)]),
        estimate_table=table if contents.sizes[3] else "",
        estimates_differ=differ if contents.sizes[3] else "",
        state_tests=indented(_final_state(printed)),
        refused_tests=indented(_refused(printed)),
        frozen_tests=indented(_frozen(printed), 8),
        limit_tests=indented(_limits(printed)),
        fresh_tests=indented(_fresh(printed)),
        saturated=_saturated(printed),
        started=layout.started.name,
        u=layout.u.name,
        start_argument=f"in.{printed.measured}, " if state else "",
        fixed_start="measured[0], " if state else "",
        tiny=c99.constant(1e-3, contents.real),
        zero=f"0.0{contents.real.suffix}",
    )


def _rows(printed: Printed, values: Array) -> str:
    real = printed.contents.real
    return indented(f"{{ {', '.join(c99.constant(value, real) for value in row)} }}," for row in values)


def _final_state(printed: Printed) -> list[str]:
    """After the last vector every number of the state is the simulation's."""
    contents, lines = printed.contents, []
    last = contents.vectors.states[-1]
    for part in contents.layout.parts:
        values = ", ".join(c99.constant(last[row], contents.real) for row in part.rows)
        lines.append(f"{{ const {printed.real} expected[{part.size}] = {{ {values} }};")
        lines.append(f'  require(same(c.{part.name}, expected, {part.size}), "the state differs: {part.name}"); }}')
    return lines


def _refused(printed: Printed) -> list[str]:
    """Meanwhile what is learnt stands still, and the model goes on as it would have."""
    contents = printed.contents
    lines = ['require(c.waiting == 1, "a refused sample is not remembered");']
    if contents.sizes[3]:
        name = contents.layout.theta_hat.name
        lines.append(f'require(same(c.{name}, before.{name}, {printed.macro}_ESTIMATES), "a refused sample was learnt from");')
    part = contents.layout.part("held.x_m")
    if part is not None:
        Phi, Gamma = _discrete_model(printed)
        lines += ["for (i = 0; i < 2; ++i) {", f"    {printed.real} next[{part.size}];"]
        held = contents.layout.part("held.r")
        for i in range(part.size):
            terms = [f"{c99.constant(Phi[i, j], contents.real)} * before.{part.name}[{j}]" for j in range(part.size)]
            terms += [] if held is None else [
                f"{c99.constant(Gamma[i, j], contents.real)} * before.{held.name}[{j}]" for j in range(Gamma.shape[1])
            ]  # fmt: skip
            lines.append(f"    next[{i}] = {' + '.join(terms)};")
        lines += [f"    memcpy(before.{part.name}, next, sizeof next);", "}"]
        for i in range(part.size):
            found, expected = f"c.{part.name}[{i}]", f"before.{part.name}[{i}]"
            lines.append(
                f"require({found} - {expected} <= {c99.constant(1e-4, contents.real)} && {expected} - {found} <= "
                f'{c99.constant(1e-4, contents.real)}, "the model does not go on while samples are refused");'
            )
    return lines


def _discrete_model(printed: Printed) -> tuple[Array, Array]:
    discrete = printed.contents.loop.discrete_model
    assert discrete is not None
    return discrete.Phi, discrete.Gamma.reshape(len(discrete.Phi), -1)


def _frozen(printed: Printed) -> list[str]:
    contents, lines = printed.contents, []
    for part in contents.layout.parts:
        for i in (row - part.start for row in part.rows if row in contents.learnt):
            both = f"&c.{part.name}[{i}], &before.{part.name}[{i}]"
            lines.append(f'require(same({both}, 1), "frozen, and {part.name} moves");')
    return lines


def _fresh(printed: Printed) -> list[str]:
    """Enabled after it was disabled, whatever happened before: as from a fresh start, where that state is a copy of x."""
    contents = printed.contents
    _, of_x = contents.at_start
    if not np.isin(of_x, (0.0, 1.0)).all() or (of_x.sum(axis=1) > 1).any():
        return []
    x0 = contents.problem.dynamics.x0
    values = ", ".join(c99.constant(value, contents.real) for value in x0)
    started = f"{printed.name}_start(&c, {'x0, ' if contents.measures_state else ''}controls[0], 0L, 0);"
    given = f"const {printed.real} x0[] = {{ {values} }};" if contents.measures_state else ""
    return [
        f"{{ {given} {started}",
        '  require(replay(&c, SAMPLES) == SAMPLES, "enabled again, it is not as from a fresh start"); }',
    ]


def _limits(printed: Printed) -> list[str]:
    """An estimate outside the known set is refused as a state; the actuator's limits are kept."""
    contents = printed.contents
    if contents.limits is None or not contents.sizes[3]:
        return []
    lines = []
    name = contents.layout.theta_hat.name
    for side, sign in (("LOWER", "-"), ("UPPER", "+")):
        lines += [
            f"{{ const {printed.real} bounds[] = {printed.macro}_THETA_HAT_{side};",
            f"  for (i = 0; i < {printed.macro}_ESTIMATES; ++i) {{",
            f"      {printed.name}_init(&c);",
            f"      c.{name}[i] = bounds[i] {sign} {c99.constant(0.01, contents.real)} * (1 + bounds[i] * bounds[i]);",
            f"      require({printed.name}_step(&c, &in, &out) == {printed.macro}_STATE_REFUSED,",
            '          "an estimate outside the known set is not refused");',
            "  } }",
        ]
    return lines


def _saturated(printed: Printed) -> str:
    if printed.contents.saturation is None:
        return "same(&out.u_limited[i], &out.u[i], 1)"
    tests = []
    for i, (low, high) in enumerate(printed.contents.saturation.T):
        a, b, u = printed.number(low), printed.number(high), f"out.u[{i}]"
        tests.append(f"(i != {i} || out.u_limited[{i}] == ({u} < {a} ? {a} : {u} > {b} ? {b} : {u}))")
    return " && ".join(tests)
