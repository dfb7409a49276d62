"""``python -m prf``, and what the command `prf` runs."""

from __future__ import annotations

from prf.shell.cli import end_quietly


def main() -> None:
    """Run the tool; Ctrl-C while it is imported ends it without a traceback."""
    end_quietly()
    from prf.cli import main as run  # noqa: PLC0415 - takes a fifth of a second, in which Ctrl-C may come

    run()


if __name__ == "__main__":
    main()
