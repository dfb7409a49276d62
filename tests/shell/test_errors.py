from __future__ import annotations

from prf.shell.errors import LONGEST_MESSAGE, InputError, Interrupted


def test_a_message_is_one_line_that_a_terminal_only_shows():
    error = InputError("a\nb.log:3: \x1b[2J\tis no number \u2028 \x00. Ünï \U0001f600 stays.")
    assert str(error) == "a b.log:3: \\x1b[2J is no number   \\x00. Ünï \U0001f600 stays."
    assert str(error).isprintable()


def test_a_long_message_keeps_its_beginning_and_its_remedy():
    message = str(InputError("a.ply: " + "x" * 100_000 + ". Mend it."))
    assert len(message) < LONGEST_MESSAGE + 10
    assert message.startswith("a.ply: xx")
    assert message.endswith("xx. Mend it.")


def test_a_signal_keeps_its_code():
    assert (str(Interrupted("kept", 15)), Interrupted("kept", 15).exit_code) == ("kept", 143)
