"""How a tool ends: errors as one line on standard error with their exit code, and signals.

A long run polls them as a flag, so that Ctrl-C ends it after a checkpoint and not in the middle of one; before there
is anything to keep it ends at once.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

import typer

from prf.shell.cli import console, outputs
from prf.shell.cli.files import FULL, remove_all_temporary
from prf.shell.errors import (
    EXIT_BROKEN_PIPE,
    EXIT_INTERNAL,
    EXIT_OK,
    InputError,
    Interrupted,
    OutputError,
    PrfError,
    system_reason,
)

_NOT_GIVEN = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP, errno.EIO, errno.ENXIO)
"""What the system answers already when it is asked whether there is a file."""


def run_app(command: Any, name: str, args: Sequence[str] | None = None) -> int:
    """Run a tool, a `command` of :func:`prf.shell.cli.app.make_app`, and return its exit code.

    `name`: as help texts and errors call it. `args`: instead of ``sys.argv[1:]``.
    """
    console.reset(_verb_path(command, name, args))
    with ending_the_tool(), console.warnings_as_details():
        return _run(command, name, args)


def _run(command: Any, name: str, args: Sequence[str] | None) -> int:
    try:
        code = command.main(args, prog_name=name, standalone_mode=False)
        sys.stdout.flush()
    except PrfError as error:
        _show_traceback()
        console.report_error(str(error))
        return error.exit_code
    except typer.TyperException as error:
        return _report_usage(error, _verb_path(command, name, args))
    except (KeyboardInterrupt, typer.Abort):
        return 130
    except (BrokenPipeError, SystemExit) as error:
        return _code_of_exit(error)
    except OSError as error:
        return _report_refusal(error)
    except MemoryError as error:
        return _report_no_memory(error)
    except Exception as error:
        return _report_internal(error)
    finally:
        outputs.release_claims()
    return code if isinstance(code, int) else EXIT_OK


def _show_traceback() -> bool:
    wanted = console.settings.verbosity >= 2
    if wanted:
        traceback.print_exc()
    return wanted


def _verb_path(command: Any, name: str, args: Sequence[str] | None) -> str:
    """Return what to ask for help: tool and verb, or the tool alone where no verb is named."""
    words = sys.argv[1:] if args is None else args
    verb = next((word for word in words if not word.startswith("-")), None)
    return f"{name} {verb}" if verb in getattr(command, "verbs", {}) else name


def _report_usage(error: Any, path: str) -> int:
    """Report what typer found wrong with the command line; some of its errors do not know the verb."""
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else path
    message = error.format_message().replace("Value error, ", "").rstrip(".")
    stop = "" if message.endswith("?") else "."
    console.report_error(f"{message}{stop}{_place_of_logs(message, context)} See '{path} --help'.")
    return int(error.exit_code)


def _place_of_logs(message: str, context: Any) -> str:
    """Return the option that a log was meant for, where one was given without."""
    found = re.search(r"unexpected extra argument\S* \((.+)\)", message)
    if context is None or found is None:
        return ""
    takes_log = any("--laser" in param.opts and param.metavar for param in context.command.params)
    return f" Did you mean --laser {found[1]}?" if takes_log else ""


def _report_no_memory(error: MemoryError) -> int:
    """Report that a result, or what leads to it, does not fit into memory."""
    _show_traceback()
    words = f" ({error})" if str(error) else ""
    console.report_error(f"out of memory{words}. Reduce the job, or use a machine with more.")
    return EXIT_INTERNAL


def _report_internal(error: Exception) -> int:
    """Report a fault of ours."""
    hint = "" if _show_traceback() else " Please rerun with -vv and report the traceback."
    console.report_error(f"internal error: {type(error).__name__}: {error}.{hint}")
    return EXIT_INTERNAL


def _code_of_exit(error: BaseException) -> int:
    """Return the code of an explicit exit; a reader that closed the pipe is not an error.

    Typer turns a broken pipe into ``SystemExit(1)``, which with us would mean "the check failed".
    """
    if isinstance(error, BrokenPipeError) or isinstance(error.__context__, BrokenPipeError):
        _abandon_stdout()
        return EXIT_BROKEN_PIPE
    return error.code if isinstance(error, SystemExit) and isinstance(error.code, int) else EXIT_OK


def _report_refusal(error: OSError) -> int:
    """Report a disk without room, or a file that the system does not give."""
    if error.errno in FULL:
        _abandon_stdout()
        console.report_error(f"the result cannot be written: {system_reason(error)}.")
        return OutputError.exit_code
    if error.errno in _NOT_GIVEN and error.filename is not None:
        console.report_error(str(InputError(f"{os.fsdecode(error.filename)}: {system_reason(error)}.")))
        return InputError.exit_code
    return _report_internal(error)


def _abandon_stdout() -> None:
    """Keep Python from flushing standard output once more at its end: it would complain a second time."""
    sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - stays open to the end


logger = logging.getLogger(__name__)

_STOPPING = (signal.SIGINT, signal.SIGTERM)
_DEAF = ("numba", "llvmlite")
"""Packages that are called back from compiled code, which prints an exception and continues."""


class StopFlag:
    """Set by the first SIGINT or SIGTERM; a driver polls it between steps."""

    def __init__(self, has_result: bool = True) -> None:
        self.signal_number = 0  # 0 while none has come
        self.has_result = has_result  # whether there is something to keep; the driver sets it

    @property
    def requested(self) -> bool:
        """Whether the run has been asked to stop."""
        return self.signal_number != 0

    def raise_if_requested(self, message: str) -> None:
        """Raise :class:`Interrupted` (exit code 130 or 143) if the run has been asked to stop.

        `message`: what was kept and how to continue, e.g. ``interrupted; continue with --resume demo/office``.
        """
        if self.requested:
            raise Interrupted(message, self.signal_number)


@contextmanager
def _handled(signals: Sequence[signal.Signals], handler: Callable[[int, FrameType | None], Any]) -> Iterator[None]:
    """Handle signals in the block, but those that are ignored; nothing outside the main thread, where none can be."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = _handlers(signals)
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        _restore(before)


def _handlers(signals: Sequence[signal.Signals]) -> dict[signal.Signals, Any]:
    """Return the handlers of signals, but of those that are ignored, or handled outside Python."""
    before = {number: signal.getsignal(number) for number in signals}
    return {number: old for number, old in before.items() if old not in (None, signal.SIG_IGN)}


def _restore(handlers: Mapping[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


@contextmanager
def graceful_stop(signals: Sequence[signal.Signals] = _STOPPING, has_result: bool = True) -> Iterator[StopFlag]:
    """Turn the first SIGINT or SIGTERM (or other `signals`) into a :class:`StopFlag`; the second acts as without it.

    While the flag's `has_result` is False, as here at first where nothing can be kept yet, the first one ends the tool.
    """
    flag = StopFlag(has_result)
    before = _handlers(signals)

    def request(number: int, _frame: FrameType | None) -> None:
        flag.signal_number = number
        _restore(before)
        if flag.has_result:
            logger.info("saving; press Ctrl-C again to quit now")
            return
        logger.error("interrupted before the first step; nothing new was saved")
        if before[signal.Signals(number)] is _end:
            _end_now(number)  # what threads compile ends in no other way
        signal.raise_signal(number)

    with _handled(signals, request):
        yield flag


def _is_deaf(frame: FrameType | None) -> bool:
    """Return whether what a signal interrupts, or what called that, would lose an exception or make another of it."""
    while frame is not None:
        package = str(frame.f_globals.get("__name__")).partition(".")[0]
        if package in _DEAF or frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _end_now(number: int) -> NoReturn:
    """End the process, and leave nothing half written."""
    remove_all_temporary()
    os._exit(128 + number)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    """End the tool through its ``finally`` clauses; where no exception passes, in imports and compilers, at once."""
    if _is_deaf(frame):
        _end_now(number)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


@contextmanager
def ending_the_tool() -> Iterator[None]:
    """Let SIGINT and SIGTERM end the tool (exit codes 130 and 143) and leave nothing half written, while it runs."""
    with _handled(_STOPPING, _end):
        yield
