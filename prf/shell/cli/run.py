"""The one place where errors end: one line on standard error, and the exit code that goes with it."""

from __future__ import annotations

import errno
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import Any

import typer

from prf.shell.cli import console, outputs, signals
from prf.shell.cli.files import FULL
from prf.shell.errors import EXIT_BROKEN_PIPE, EXIT_INTERNAL, EXIT_OK, InputError, OutputError, PrfError, system_reason

_NOT_GIVEN = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP, errno.EIO, errno.ENXIO)
"""What the system answers already when it is asked whether there is a file."""


def run_app(command: Any, name: str, args: Sequence[str] | None = None) -> int:
    """Run a tool, a `command` of :func:`prf.shell.cli.app.make_app`, and return its exit code.

    `name`: as help texts and errors call it. `args`: instead of ``sys.argv[1:]``.
    """
    console.reset()
    with signals.ending_the_tool(), console.warnings_as_details():
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
