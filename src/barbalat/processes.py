"""Worker processes of a command: they leave Ctrl-C to the command and end when it ends."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import active_children, get_context, resource_tracker
from threading import current_thread, main_thread
from typing import ParamSpec, TypeVar

from barbalat import budget
from barbalat.budget import Budget

Given = ParamSpec("Given")
Answer = TypeVar("Answer")


def answer_of(asked: Future[Answer], function: Callable[Given, Answer], /, *given: Given.args, **named: Given.kwargs) -> Answer:
    """The result of a submitted call. A call that no process has started is executed here."""
    return function(*given, **named) if asked.cancel() else asked.result()


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """Worker processes with this process's garbage-collection thresholds and budget. If an exception leaves the block, it does
    not wait for their work.

    The processes start with the first submitted call, which belongs inside ``deaf_children``. The program must be importable by a
    new process: it starts under ``if __name__ == "__main__"``.
    """
    others = active_children()
    given = gc.get_threshold(), replace(budget.in_force(), told=None)
    pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_begin, initargs=given)
    try:
        yield pool
    except BaseException:
        for child in active_children():
            if child not in others:
                child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(thresholds: tuple[int, int, int], limits: Budget) -> None:
    """Set up a new process."""
    gc.set_threshold(*thresholds)
    limits.__enter__()


@contextmanager
def deaf_children() -> Iterator[None]:
    """Processes that start inside this block ignore Ctrl-C, which a terminal sends to all; otherwise they would print tracebacks.

    They inherit the blocked signal. In this process the signal is not lost and does not interrupt a half-started worker: it is
    delivered after the block. A termination request also waits here, but stays unblocked in the workers, because this process
    uses it to end them.
    """
    if sys.platform == "win32" or current_thread() is not main_thread():  # signals can't be blocked or don't arrive here
        yield
        return
    resource_tracker.ensure_running()  # it would start with the first process and unblock the signal
    with undisturbed():  # the signal may be delivered to a different thread
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def undisturbed() -> Iterator[None]:
    """Defer Ctrl-C, a termination request and an alarm to the end of this block, whose code would report their exceptions as
    errors."""
    if current_thread() is not main_thread():  # no signal is delivered to this thread
        yield
        return
    kept = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32":
        kept.append(signal.SIGALRM)
    waiting: list[int] = []
    before = {number: signal.signal(number, lambda number, _: waiting.append(number)) for number in kept}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if waiting:
        signal.raise_signal(signal.Signals(waiting[0]))
