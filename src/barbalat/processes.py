"""Processes of a command's own, which leave Ctrl-C to it and end with it."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import active_children, get_context, resource_tracker
from threading import current_thread, main_thread
from typing import ParamSpec, TypeVar

from barbalat import budget
from barbalat.budget import Budget

Given = ParamSpec("Given")
Answer = TypeVar("Answer")


class Here(Executor):
    """No process at all: what is submitted is done at once."""

    def submit(self, function: Callable[Given, Answer], /, *given: Given.args, **named: Given.kwargs) -> Future[Answer]:
        """What the function answers; it raises here."""
        done: Future[Answer] = Future()
        done.set_result(function(*given, **named))
        return done


def answer_of(asked: Future[Answer], function: Callable[Given, Answer], /, *given: Given.args, **named: Given.kwargs) -> Answer:
    """What this call, which was submitted, answers; where no process has begun it, it is made here."""
    return function(*given, **named) if asked.cancel() else asked.result()


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """So many processes, which collect garbage as often as this one and have its budget; whatever they are at when this is left
    by an exception, nobody waits for.

    What is submitted first, and with it starts them, belongs into ``deaf_children``. The program that calls this must be one that
    a new process may import: started by ``if __name__ == "__main__"``.
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
    """In a new process."""
    gc.set_threshold(*thresholds)
    limits.__enter__()


@contextmanager
def deaf_children() -> Iterator[None]:
    """Processes that start meanwhile leave Ctrl-C, which a terminal sends to all, to this one: they would print tracebacks.

    They inherit that it is blocked. Here it is neither lost, nor does it interrupt a process that is half started: it waits, as
    a request to end does, to which they stay open: it is how this one ends them.
    """
    if sys.platform == "win32" or current_thread() is not main_thread():  # where signals can't be blocked, and none arrive
        yield
        return
    resource_tracker.ensure_running()  # it would unblock the signal when the first process starts it
    with undisturbed():  # another thread may be the one to get it
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ctrl-C, a request to end, and an alarm wait until this is left: for code that would report what is raised within it."""
    if current_thread() is not main_thread():  # to which none arrives
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
