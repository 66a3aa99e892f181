"""README.md of an export: what it is, how to call it, how to check it."""

from __future__ import annotations

from barbalat.export.contents import is_explicit
from barbalat.export.header import shape
from barbalat.export.meanings import meaning
from barbalat.export.texts import Printed, comment

_README = """\
# {title}

{origin}

| file | what |
|---|---|
| `controller.h` | types, functions, limits; what each name means |
| `controller.c` | the controller: {operations} operations a sample, {numbers} numbers of state; library calls: {calls} |
| `selftest.c` | a program that replays {samples} samples of the simulation; exit code 0: it agrees in every bit |

## Check it first, on the machine that will run it

    cc -std=c99 -ffp-contract=off -O2 controller.c selftest.c -o selftest{library} && ./selftest

The operations are those of `barbalat run`, in the same order, without fused multiply-adds. They give the same bits wherever
+ - * / and sqrt are those of IEEE 754 and nothing is contracted: `-std=c99 -ffp-contract=off`. GNU mode (`-std=gnu99`, which is
what gcc takes by itself) fuses on aarch64 and riscv64, x87 computes with more digits, `-ffast-math` with any: the self-test sees
each of them. It also compiles as C++17.

## Call it

    static {name}_controller c;          /* yours: there is no heap and no global */
    {name}_input in;
    {name}_output out;

    {name}_init(&c);                     /* as the simulation starts */
    /* every {sample_time} s: */
    in.sample_time = {macro}_SAMPLE_TIME;
    in.{measured}[0] = ...;                       /* {measured_count} measured */
    in.r[0] = ...;                       /* {commands} */
    in.freeze = 0;
    status = {name}_step(&c, &in, &out);
    /* put out.u_limited[0] out at once, hold it until the next call */

- *Start in flight*: `{name}_start(&c, {start}u_now, samples, keep_estimates)`. The first control is u_now, what the actuator
  has; the difference to the controller's own fades out over so many samples. After a pause start again, with keep_estimates = 1:
  what lies between is not advanced.
- *Freeze*: with `in.freeze` not 0 the estimates, and what was learnt for them, keep their values; control, model and filters go
  on.{freeze}
- *Refused*: an input or a state that is no number, or is beyond {range}{set}. The last good u is
  held and the status says why. After a bad input the next good sample goes on by itself, from where the controller stood, with a
  model that went on meanwhile; after a bad state `{name}_reset` or `{name}_start` is the way back.
- *Another sample time* than {sample_time} s is flagged, and the step made as if it were right: a wrong rate is better than no
  control.

In MATLAB/Simulink a *C Caller* block takes `controller.c` and `controller.h` (Simulation Target: custom code); wrap
`{name}_step` in a function of plain arguments that keeps the struct. On Arduino put both files into the sketch's folder, rename
`controller.c` to `controller.cpp`, and call `{name}_step` from a timer; on boards whose double has 32 bits export with
`--float32`.

## State

| member | entries | what |
|---|---|---|
{members}

Quantities are in the units of the case. What the identifiers begin with, `{name}`, is the controller's name ({title}) in
small letters, with `_` for whatever C does not take.
"""


def readme(printed: Printed) -> str:
    """The text of README.md."""
    contents = printed.contents
    layout, macro = contents.layout, printed.macro
    y, q, _, _ = contents.sizes
    functions = sorted({op.name for op in contents.step.operations} & LIBRARY)
    members = "\n".join(f"| `{part.name}` | {part.size} | {shape(part.shape)}{meaning(part.path)} |" for part in layout.parts)
    euler = is_explicit(contents) and any(part.path == "controller.swapping" for part in layout.parts)
    return _README.format(
        title=comment(contents.controller.name),
        origin=printed.origin.replace("\n *", ""),
        operations=len(contents.step.operations),
        numbers=len(layout.rows),
        calls=", ".join(functions) or "none",
        library=" -lm" if functions else "",
        samples=len(contents.vectors.states),
        name=printed.name,
        macro=macro,
        sample_time=f"{contents.sample_time!r}",
        measured=printed.measured,
        measured_count=f"{y} state{'s' if y > 1 else ''}" if contents.measures_state else "the output",
        commands=f"{q} commands" if q > 1 else "the command",
        start=f"{printed.measured}, " if contents.measures_state else "",
        range=f"{contents.range:g}",
        set=", or an estimate outside the known set" if contents.limits is not None else "",
        freeze=EULER_SWAPPING if euler else "",
        members=members,
    )


EULER_SWAPPING = " The swapping term of (14) moves as if the law did: Euler's steps know it from the law's rate alone."

LIBRARY = {"sqrt", "fabs", "floor", "ceil", "exp", "log", "sin", "cos", "tan", "tanh", "pow", "copysign"}
"""Operations that are calls of math.h."""
