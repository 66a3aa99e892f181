"""Reliable handling of Ctrl-C and of requests to end.

CasADi drops exceptions that are raised while it reads a shape from Python or converts an argument. While Section V was traced,
4 of 40 interrupts were lost in this way.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator


class Terminated(KeyboardInterrupt):
    """A signal of ``kill``, ``timeout`` or a job scheduler asks the command to end. The command cleans up as after Ctrl-C."""


RETRY_PERIOD = 0.3
"""Seconds from one attempt to the next. A second attempt is rarely needed, and a third almost never."""


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at Ctrl-C and Terminated at SIGTERM, repeatedly until the exception leaves this block."""
    if sys.platform == "win32" or threading.current_thread() is not threading.main_thread():  # no timers and signals here
        yield
        return

    kinds: dict[int, type[KeyboardInterrupt]] = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}
    asked: list[int] = []

    def attempt(*_: object) -> None:
        if not _is_interrupt(sys.exc_info()[1]):  # otherwise folders are being cleaned up and processes ended
            raise kinds[asked[0]]

    def begin(number: int, *_: object) -> None:
        asked.append(number)
        alarms.append(signal.signal(signal.SIGALRM, attempt))
        signal.setitimer(signal.ITIMER_REAL, RETRY_PERIOD, RETRY_PERIOD)
        raise kinds[number]

    alarms: list[signal._HANDLER] = []
    before = {number: signal.signal(number, begin) for number in kinds}
    try:
        yield
    except Exception as error:
        if asked or _is_interrupt(error):  # CasADi turns an interrupt during a conversion into an error about wrong arguments
            raise kinds[asked[0] if asked else signal.SIGINT] from None
        raise
    finally:
        if alarms:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, alarms[0])
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether this is a KeyboardInterrupt or an exception that results from one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None
