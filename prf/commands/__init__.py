'''The verbs of `prf`, one a file: parse, call one library function, render.

How a verb is written: ``prf/commands/<verb>.py`` holds a function of the verb's name. Its docstring is the help text
(first line: the summary in ``prf --help``), its parameters are the options (:mod:`prf.shell.cli.options` has the shared
ones), and the module's ``EXAMPLES``, a tuple of command lines that run, ends its help::

    """Show what is in a log."""

    from __future__ import annotations

    from typing import Annotated

    import typer

    from prf.configuration import Configuration
    from prf.shell.cli.options import with_settings
    from prf.shell.cli.options import Json
    from prf.shell.cli.settings import Loaded

    EXAMPLES = ("prf info data/demo-office.log.gz", "prf info --json intel.log.gz")


    @with_settings(Configuration, "readings")
    def info(
        log: Annotated[str, typer.Argument(metavar="LOG", help="...")],
        *,
        settings: Loaded[Configuration],
        json: Json = False,
    ) -> None:
        """Show what is in a log."""
        from prf.readings import describe

`with_settings` names the tables and keys that the verb reads: it adds their flags and hands over their values.
The top of the module imports only the standard library, typer, `prf.shell` and the configuration: numpy, numba, scipy
and matplotlib are imported inside the function, so that ``--help`` answers at once. `-v`, `-q`, `--color` and
`--no-progress` are added to every verb (:mod:`prf.shell.cli.app`). The verb is then entered in the table of
:mod:`prf.cli`.
'''
