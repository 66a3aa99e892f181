"""The shell as C and in simulations: equal in every bit under each fault, and the C against a shell in plain Python."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled
from barbalat.cases.load import parse_case
from barbalat.export.c99.files import files
from barbalat.export.contents import Contents
from barbalat.export.in_the_loop import simulate_export
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE
from barbalat.plants import Bias, Dropout, Jitter, Labels, Latency, PlantInput, Shell, Spike, Stuck
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.simulate import recorded, simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError
from export.examples import SIMULATION, T
from export.targets import ISO, STRICT, drive, needs_gcc, run_selftest, same_bits, write
from export.test_bit_identical import EXAMPLES
from export.test_losses import Listed

LOST, RESULT_REFUSED, COMMAND_LOST, WRONG_TIME, JITTER, MISSED, FALLBACK = 2, 8, 16, 1, 64, 128, 256
SHELLS = {
    "none": None,
    "range and rate": Shell(range={"x_1": [-2.0, 2.0]}, rate={"x_1": 10.0, "x_2": 60.0}),
    "hold": Shell(rate={"x_1": 10.0}, longest_outage=0.03, fade=0.1),
    "zero": Shell(longest_outage=0.03, fallback="zero"),
    "fade": Shell(range={"x_2": [-4.0, 5.0]}, longest_outage=0.05, fallback="fade", fade=0.2, jitter=0.1),
    "stuck": Shell(rate={"x_1": 10.0}, stuck={"x_2": 0.04}, longest_outage=0.05, fallback="fade", fade=0.2),
    "at once": Shell(longest_outage=0.0, fallback="zero", jitter=0.2),
}
FAULTS = {
    "dropout": (Dropout(share=0.3),),
    "bursts": (Dropout(share=0.2, burst=0.08, channel="x_2"),),
    "outages": (Dropout(times=((0.0, 0.05), (1.0, 1.5))),),
    "command": (Dropout(channel="command", share=0.3), Dropout(channel="x_1", share=0.1)),
    "spike": (Spike(channel="x_1", size=3.0, share=0.05),),
    "stuck": (Stuck(channel="x_2", times=((1.0, 1.5),)),),
    "bias": (Bias(channel="x_1", size=0.7, times=((0.5, 2.0),)),),
    "jitter": (Jitter(time=0.002),),
    "latency": (Latency(time=0.03),),
    "all": (
        Latency(time=0.02, channel="x_1", share=0.5, burst=0.1),
        Jitter(time=0.0025, share=0.2),
        Dropout(share=0.2, seed=3),
        Spike(size=1.0, share=0.1),
        Dropout(channel="command", share=0.1, seed=1),
    ),
}
RUN = Simulation(t_end=3.0, dt=T / 10)


def one(beginning: str):
    return EXAMPLES[next(name for name in EXAMPLES if name.startswith(beginning))]


def surrounded(beginning: str, shell, faults=()):
    """An example with this shell and these faults, whose channels are x_1, x_2, or y where only that is measured."""
    problem, controller = one(beginning)
    if problem.feedback == "output":
        problem = replace(problem, labels=Labels(names=["x_1"]))
        faults = tuple(
            replace(fault, **({"channel": "x_1"} if getattr(fault, "channel", "") == "x_2" else {})) for fault in faults
        )
        keys = ("range", "rate", "stuck")
        shell = shell and replace(shell, **{key: {k: v for k, v in getattr(shell, key).items() if k != "x_2"} for key in keys})
    return replace(problem, shell=shell, faults=faults), controller


PAIRS = [(shell, fault) for shell in SHELLS for fault in FAULTS]


@needs_gcc
@pytest.mark.parametrize(
    "scheme", ["Mrac-state-midpoint", "L1PiecewiseConstant-state", "MracOutput-output-midpoint", "L1Adaptive-several-midpoint"]
)
@pytest.mark.parametrize(("shell", "fault"), PAIRS)
@pytest.mark.short(kept=lambda scheme, shell, fault: (scheme, shell, fault) in SHORT)
def test_the_c_in_the_loop_is_the_simulation_in_every_bit(scheme, shell, fault) -> None:
    problem, controller = surrounded(scheme, SHELLS[shell], FAULTS[fault])
    origin = simulate(problem, [controller], RUN)[controller.name]
    compiled = simulate_export(problem, controller, RUN)
    assert compiled.differs_from(origin) == ""
    nominal = simulate(problem.nominal, [controller], RUN)[controller.name]
    assert not np.array_equal(nominal.x, origin.x)


SHORT = {("Mrac-state-midpoint", list(SHELLS)[i % len(SHELLS)], fault) for i, fault in enumerate(FAULTS)}
SHORT |= {("Mrac-state-midpoint", "stuck", "stuck")}
SHORT |= {("L1Adaptive-several-midpoint", "fade", "all"), ("L1PiecewiseConstant-state", "zero", "bursts")}
SHORT |= {("MracOutput-output-midpoint", "hold", "outages")}
"""Each fault once, each shell, and the other schemes once."""


class Plain:
    """A shell in plain Python around a list of operations, sample by sample, as controller.h and the page say it."""

    def __init__(self, act: Listed, shell: Shell, names: tuple[str, ...]) -> None:
        self.act, self.shell = act, shell
        self.low, self.high = np.array([shell.range.get(name, [-np.inf, np.inf]) for name in names]).T
        self.rate = np.array([shell.rate.get(name, np.inf) for name in names])
        self.ends = shell.longest_outage is not None
        self.longest = round(shell.longest_outage / T) if self.ends else None
        fade = shell.longest_outage if shell.fade is None else shell.fade
        self.fade = round(fade / T) if self.ends else 0
        self.most = {i: round(shell.stuck[name] / T) for i, name in enumerate(names) if name in shell.stuck}
        self.same = dict.fromkeys(self.most, 0)
        self.u, self.y, self.r, self.missed, self.left, self.bump = np.zeros(len(act.u)), None, None, 0, 0, 0.0

    def sample(self, y, r, freeze, time) -> tuple[int, np.ndarray]:
        """Status and u; ``time`` is the timer's reading in sample times."""
        status, calls, wrong = 0, round(time) if np.isfinite(time) else 0, False
        if self.shell.jitter is None:
            status |= WRONG_TIME if not abs(time - 1) <= 1e-3 else 0
        elif 1 <= calls <= self.longest + 1 and abs(time - calls) <= self.shell.jitter:
            status |= MISSED if calls > 1 else JITTER if abs(time - 1) > 1e-3 else 0
            for _ in range(calls - 1 if self.y is not None else 0):
                self.miss(self.r, wrong=False)
        else:
            status, wrong = WRONG_TIME, True
        lost_r = not np.isfinite(r).all()
        lost = not wrong and not self.takes(y)
        status |= (COMMAND_LOST if lost_r else 0) | (LOST if lost else 0)
        if self.y is None and (lost or lost_r or wrong):
            return status, self.u
        r = self.r if lost_r else r
        if lost or wrong:
            self.miss(r, wrong=wrong)
        else:
            self.good(y, r, freeze)
        return status | (FALLBACK if self.ends and self.missed > self.longest else 0), self.u

    def takes(self, y) -> bool:
        if not np.isfinite(y).all() or (y < self.low).any() or (y > self.high).any():
            return False
        if self.y is not None and any(y[i] == self.y[i] and self.same[i] >= most for i, most in self.most.items()):
            return False
        return self.y is None or bool((np.abs(y - self.y) <= self.rate * T * (self.missed + 1)).all())

    def miss(self, r, *, wrong) -> None:
        self.missed = 1 + (max(self.missed, self.longest) if wrong else self.missed)
        held, beyond = self.u, self.missed - self.longest if self.ends else 0
        if beyond > 0 and self.shell.fallback != "hold":
            left = self.fade + 1 - beyond
            held = self.u * ((left - 1) / left) if self.shell.fallback == "fade" and left > 0 else np.zeros_like(self.u)
        self.u, _ = self.act(self.y, r, True, held)
        self.r = r

    def good(self, y, r, freeze) -> None:
        own, _ = self.act(y, r, freeze, None)
        if self.ends and self.missed > self.longest:
            self.bump, self.left = self.u - own, self.fade
        self.u = own + self.bump * (self.left / self.fade) if self.left else own
        self.act.step.state[self.act.u] = self.u
        self.same = {i: self.same[i] + 1 if self.y is not None and y[i] == self.y[i] else 0 for i in self.most}
        self.y, self.r, self.missed, self.left = y, r, 0, max(self.left - 1, 0)


@needs_gcc
@pytest.mark.parametrize("scheme", ["Mrac-state-midpoint", "L1Adaptive-several-euler"])
@pytest.mark.parametrize("shell", [shell for shell in SHELLS if shell != "none"])
def test_the_c_is_a_shell_in_plain_python(scheme, shell, tmp_path) -> None:
    """Every bit of u and every status through random losses, spikes, outages, missed calls and wrong times."""
    problem, controller = surrounded(scheme, SHELLS[shell])
    printed = Printed(Contents.of(problem, controller, SIMULATION, DOUBLE))
    write(tmp_path, {"controller.h": header(printed), "controller.c": source(printed)})
    samples, random = recorded(problem.nominal, controller, SIMULATION, 600), np.random.default_rng(len(shell))
    y, r, K = samples.measured.copy(), samples.commands.copy(), 600
    busy = np.repeat(random.choice([0.0, 0.1, 0.5, 0.97], size=K // 30), 30)
    y[random.random(K) < busy, 0] = np.nan
    y[random.random(K) < busy / 4] += random.choice([-0.2, 0.4, 5.0])
    r[random.random(K) < busy / 4] = np.nan
    y[100:120, -1] = y[99, -1]
    timer = np.where(random.random(K) < busy / 4, random.choice([1.0005, 1.05, 0.93, 1.5, 2.0, 3.02, 40.0, np.nan], size=K), 1.0)
    found = drive(printed, tmp_path, y, r, timer=timer)
    plain = Plain(Listed(problem.nominal, controller), SHELLS[shell], problem.measured_names)
    expected = [plain.sample(y[k], r[k], False, timer[k]) for k in range(K)]
    assert found.status.tolist() == [status for status, _ in expected]
    assert same_bits(found.u, np.array([u for _, u in expected]))
    seen = np.bitwise_or.reduce(found.status)
    assert seen & LOST and (plain.ends == bool(seen & FALLBACK))


@needs_gcc
@pytest.mark.parametrize("scheme", ["Mrac-state-midpoint", "L1PiecewiseConstant-several", "MracOutput-output-midpoint"])
@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.short(kept=lambda scheme, shell: scheme.startswith("Mrac-") and shell in ("fade", "at once"))
def test_an_export_with_a_shell_passes_its_own_test(scheme, shell, tmp_path) -> None:
    problem, controller = surrounded(scheme, SHELLS[shell])
    for float32 in (False, True):
        write(tmp_path, files(problem, controller, SIMULATION, float32=float32))
        done = run_selftest(tmp_path, "gcc", *ISO, *STRICT, "-O1")
        assert done.returncode == 0, done.stdout


@needs_gcc
@pytest.mark.parametrize("fallback", ["hold", "zero", "fade"])
def test_results_out_of_range_end_in_the_fallback_and_the_controller_returns(fallback, tmp_path) -> None:
    """A command that is accepted once and leads the model out of range, and with it every later sample."""
    problem = Problem(
        Plant(A_m=[[0, 1], [-2000, -90]], b=[0, 2000], theta=[0.1, -0.01], input=PlantInput(saturation=[-5, 5])),
        ReferenceModel(k_0=1),
        Sine(amplitude=0.3, frequency=2),
        uncertainty=ParameterBox(lower=[-0.2, -0.02], upper=[0.2, 0.02]),
        shell=Shell(longest_outage=0.05, fallback=fallback, fade=0.1),
    )
    printed = Printed(Contents.of(problem, Sampled(Mrac(gamma=1e-3), T), SIMULATION, DOUBLE))
    write(tmp_path, {"controller.h": header(printed), "controller.c": source(printed)})
    samples, K, bad = recorded(problem.nominal, printed.contents.controller, SIMULATION, 200), 200, 100
    r = samples.commands.copy()
    r[bad] = 2e5
    found = drive(printed, tmp_path, samples.measured, r)
    refused = (found.status & RESULT_REFUSED) != 0
    assert found.status[bad] == 0 and refused[bad + 1 : bad + 7].all()
    assert (found.status[bad + 1 : bad + 6] == RESULT_REFUSED).all() and found.status[bad + 6] == RESULT_REFUSED | FALLBACK
    assert (found.status[bad + 7 :] == 0).all()
    if fallback == "zero":
        assert found.u[bad + 6] == 0
    assert abs(found.u[bad + 7] - found.u[bad + 6]) <= 1e-9 * abs(found.u[bad + 6]) + 0.05
    after = slice(bad + 40, K)  # the whole bump, which is as large as the command was, has faded out
    assert np.abs(found.u[after] - drive(printed, tmp_path, samples.measured, samples.commands).u[after]).max() < 0.05


PLANTED = {
    "no miss is counted": ("            ++c->outage;", "            ;"),
    "an outage never ends": ("c->outage > {M}_LONGEST_OUTAGE; ++i", "c->outage > 2000000000L; ++i"),
    "an outage ends at once": ("c->outage > {M}_LONGEST_OUTAGE; ++i", "c->outage > 0L; ++i"),
    "a return with a bump": ("            c->fade_left = {M}_FADE;\n", ""),
    "misses are never forgotten": ("        c->outage = 0L;\n        fade", "        fade"),
    "the fallback is not told": ("        status |= {M}_FALLBACK;\n", ""),
    "a fade to another value": ("(double)less", "(double)left"),
    "no upper end": ("in->x[1] <= 0x1.4", "in->x[1] <= 0x1.4p9 && in->x[1] <= 0x1.4p9 || in->x[1] <= 0x1.4"),
    "no lower end": ("in->x[1] >= -0x1.0000000000000p+2", "in->x[1] >= -0x1.0000000000000p+3"),
    "another band": ("    if (off <= band && -off", "    if (off <= 2 * band && -off"),
    "missed calls are none": ("        --missed;\n", "        missed = -1L;\n"),
    "a wrong time is taken": ("            measured = -1;\n", ""),
    "a start keeps the outage": ("    c->matching = 1;\n    c->outage = 0L;\n    return", "    c->matching = 1;\n    return"),
    "any number of calls": ("        return -1L;\n", "        return 0L;\n"),
    "no band of missed calls": ("return (off <= band && -off", "return (off <= 0 && -off"),
    "one call too few": ("(double){M}_LONGEST_OUTAGE + 1.5", "(double){M}_LONGEST_OUTAGE + 0.5"),
    "the edge is outside of the band": ("_BAND + 0x1", "_BAND - 0x1"),
    "a start anywhere": ("!(x[1] <= 0x1.4", "!(x[1] <= 9 * 0x1.4"),
    "results out of range are no misses": ("        begin_again(&before, c, in, measured);\n", ""),
    "no way back from them": ("        begin(c, in->x, 1);\n", ""),
    "one call too many": ("(double){M}_LONGEST_OUTAGE + 1.5", "(double){M}_LONGEST_OUTAGE + 2.5"),
}
"""What surrounds the arithmetic of an export with every part of a shell but a rate, and what is planted in its place."""


@needs_gcc
@pytest.mark.parametrize("fault", PLANTED)
@pytest.mark.short(kept=lambda fault: list(PLANTED).index(fault) % 4 == 0)
def test_the_self_test_finds_what_is_planted_in_the_shell(fault, tmp_path) -> None:
    problem, controller = surrounded("Mrac-state-midpoint", SHELLS["fade"])
    made = files(problem, controller, SIMULATION)
    macro = re.search(r"#define (\w+)_CONTROLLER_H", made["controller.h"])[1]
    original, planted = (text.replace("{M}", macro).replace("{n}", macro.lower()) for text in PLANTED[fault])
    assert original in made["controller.c"]
    write(tmp_path, made | {"controller.c": made["controller.c"].replace(original, planted, 1)})
    assert run_selftest(tmp_path, "gcc", *ISO, "-O1", "-w").returncode == 1


CASE = """
name = "shell"
[plant]
A_m = [[0.0, 1.0], [-2.0, -3.0]]
b = [0.0, 1.0]
theta = [1.0, -0.5]
x0 = [0.3, -0.2]
[labels]
names = ["angle", "rate"]
[reference_model]
k_0 = 2.0
[reference]
kind = "constant"
value = 1.0
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 2.0
sample_time = 0.01
"""


@pytest.mark.parametrize(
    ("added", "sentence"),
    [
        ("[shell]\nstuck = { rate = 0.001 }", "shell.stuck.rate must be at least the sample time of 0.01 s, got 0.001 s"),
        ("[shell]\nrange = { angel = [-1, 1] }", "shell.range.angel does not name a measured channel; there are angle, rate"),
        (
            '[[faults]]\nkind = "spike"\nsize = 1.0\nshare = 0.1\nchannel = "x_1"',
            "faults 1 (spike): channel must be one of angle, rate",
        ),
        (
            '[[faults]]\nkind = "latency"\ntime = 0.015',
            "a latency's time must be a whole number of sample times of 0.01 s, got 0.015 s",
        ),
        ('[[faults]]\nkind = "jitter"\ntime = 0.003', "a jitter's time must be at most a quarter of the sample time of 0.01 s"),
        (
            2 * '[[faults]]\nkind = "jitter"\ntime = 0.002\n',
            "a quarter of the sample time of 0.01 s, also for several jitters together, got 0.004 s",
        ),
        ('[[faults]]\nkind = "jitter"\ntime = 1e-5', "a jitter's time must be at least simulation.dt = 0.001 s, got 1e-05 s"),
        (
            '[[faults]]\nkind = "dropout"\nshare = 0.1\n[[controller]]\nname = "c"\nscheme = "mrac"\ngamma = 2.0',
            "c is continuous: give it a",
        ),
    ],
)
def test_what_does_not_fit_a_case_is_refused(added, sentence) -> None:
    with pytest.raises(InputError) as told:
        parse_case(CASE + added)
    assert sentence in str(told.value)


def test_a_shell_that_refuses_the_case_itself_is_not_exported() -> None:
    case = parse_case(CASE + "[shell]\nrange = { angle = [-0.5, 0.5] }")
    with pytest.raises(InputError, match=r"shell.range.angle refuses the case's own run: angle leaves it at sample \d+, t = "):
        files(case.problem, case.controllers[0], case.simulation)


def test_without_faults_and_refusals_a_shell_changes_no_bit() -> None:
    problem, controller = surrounded("Mrac-state-midpoint", SHELLS["fade"])
    with_it, without = (simulate(one, [controller], RUN)[controller.name] for one in (problem, problem.nominal))
    assert same_bits(with_it.x, without.x) and same_bits(with_it.u, without.u)


@needs_gcc
def test_numbers_of_a_shell_may_be_arguments_of_a_kernel() -> None:
    """No number uses fused multiply-adds, except those of the controller's own list and of the surrounding code."""
    problem, controller = surrounded("Mrac-state-midpoint", SHELLS["fade"], FAULTS["all"])
    plain = replace(RUN, fused=False, t_end=1.0)
    origin = simulate(problem, [controller], plain)[controller.name]
    assert simulate_export(problem, controller, plain).differs_from(origin) == ""


def test_members_of_an_ensemble_may_differ_in_ranges_and_rates() -> None:
    """Each equals its single run, except for fused sums."""
    spikes = (Spike(channel="x_1", size=0.4, share=0.1),)
    shells = [Shell(range={"x_1": [-2.0, high]}, rate={"x_1": 1.0 / high}) for high in (0.3, 0.5, 2.0)]
    made = [surrounded("Mrac-state-midpoint", shell, spikes) for shell in shells]
    members = [(replace(problem, sensor=None), controller) for problem, controller in made]  # each member has its own noise
    together = Batch.of(members, RUN)
    run([together], members[0][0].signals, RUN)
    found = together.metrics(RUN).max_abs_e
    for errors, (problem, controller) in zip(found, members, strict=True):
        alone = Batch.of([(problem, controller)], RUN)
        run([alone], problem.signals, RUN)
        np.testing.assert_allclose(errors, alone.metrics(RUN).max_abs_e[0], rtol=1e-9)
    assert len({tuple(one) for one in found}) == len(members)
