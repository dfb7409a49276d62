"""Panics of Rust: one line of ours, and nothing on standard error before it."""

from __future__ import annotations

import base64
import os
import threading
import zlib
from collections.abc import Callable

import pytest

from mapq.io import read_cloud
from mapq.io.panics import panics_unheard
from prf.shell.errors import InputError

SYMBOL_OUT_OF_RANGE = (
    b"eNrzcQx2Y8ACGFn8Qzxcgxhwg5zE4oJKBSM9cz0DrPJujK/Yyxk3MjEwABFDuwpOg/6s/HjJNynAHkZXi6xzf1iVYg+SU1gj5QiiT2wJcYSo"
    b"jnSotTeNWwcU3zdfan3jainH/kNfX1wEyjslPJU4DKQ9Hlbh1wXki6C5gQnmbRw0AxqfCQefCYe5mPLJ+QXJqCYvYBj6AJgoqjILFFLzkvNT"
    b"UlMYGPaE6TFklJQUWOnrQ6T08ovS0fQwg8IFGjABhxkY/qMBJgYuBjmgKm4GNiC5lxWikqObgeFpEpjZ0OrKdyfbI0bvqpdZw70lRSbv9x+9"
    b"umWz7klQLLcBMSgpiQOxEBDrAbEBlA9izwfiFgaIrX3OXjP+3ryvtLNYNG3Rb/aIXv3r2pJ+Kqb902xz/y3kXWvPfzl2h/9Wx1n/Puw4oHTo"
    b"nrj75B1fNsZcZK9jXp5mvVlL5OMD24UK+3KWZ+2OmpG1dqnL/qADVrcTVr6LVfzippenWt3LrqKjF+Uy+bJzx6E0sfM3GY7uUt2+vHDGfbuY"
    b"FYKdQFf8sFrmd/+p59qjLpUnJj0onSZnekvt1q/tFz07mleZKq4v1TeY0tMW9Tv3+ZZ8Nn4LvzZF686GR7lHPk/isNkJ1O7II61+TN5dRPdW"
    b"918Da76SVa1s7EDhTX170tkrOnNYQn+brfr9EyjSE8+d8Hv1YSXNhgMsczyXm3X5/ZwQVr5W/U6+Uv7x9vVrX3Wt10z+unfKPMlsoOqnh6bM"
    b"nOmxfMfqdQvvX3id9OL98VY366KsIt3WLS0/yzSj3i4xFVq907O8OFH+7mag+sdfXu01vqg1nUEs7WGKSvpvj6uzTIHCJ3/LX0hZ3LSrIuHh"
    b"JDYGscwO7TuTot67iOR9ynG/Kelb8Ot784xZHuwL/yzzAGUQ736rLVyfOZ/aHRdZL/dPvSXz5kPJZYzxime9Kv/96st2jWyVeTnzYlKqFnPT"
    b"xtuGbekXuqr3Wro/T32YVzeTa9Obr5WHXi6bK/5iKWvFu4mvFNI/CwgdWFZ4+FODS7tF+8E5bQX7Lplo3Jn2w+DL4g27BG6onhWx+epyWFBs"
    b"7e8tcsrLhS4n3T96vH2/+DIGwcPH+4NTCjPc3s/5M3O/99u81aBi8f+lghwW1u9/mfzPvhOb/Tsj8o2U5/WPi2tMX32zv/pVUW/D/j/3lCpd"
    b"Lf5vPvrYv+Lj/5Vnsi+Vuv6f2hB39mPx3/5lN1Nf2/8oq5JYxDD9y653E1aZyv9gEX8q0R3+as41j9b9W3Ovm/3mqL/A9mT1n7x/GnNMGVtV"
    b"/78s6ClOfP5j0/Et72o8kUqg4EwvBgYA8ybBdA=="
)
"""Twenty points whose colours, damaged, make the decompressor read beyond a table of its own."""


def panic(*steps: Callable[[], object]) -> None:
    with panics_unheard():
        os.write(2, b"thread panicked")
        for step in steps:
            step()
        raise ValueError("known")


def test_what_was_written_is_lost_with_an_exception(capfd) -> None:
    with pytest.raises(ValueError, match="known"):
        panic()
    os.write(2, b"after")
    assert capfd.readouterr().err == "after"


def test_what_was_written_is_late_without_one(capfd) -> None:
    with panics_unheard():
        os.write(2, b"first ")
        assert capfd.readouterr().err == ""
    os.write(2, b"second")
    assert capfd.readouterr().err == "first second"


def test_threads_share_it(capfd) -> None:
    inside, may_go = threading.Event(), threading.Event()

    def beside() -> None:
        with pytest.raises(ValueError, match="known"):
            panic(inside.set, lambda: may_go.wait(20.0))

    other = threading.Thread(target=beside)
    other.start()
    inside.wait(20.0)
    with panics_unheard():
        may_go.set()
        other.join()
    os.write(2, b"after")
    assert capfd.readouterr().err == "after"


def test_without_a_standard_error_work_goes_on() -> None:
    kept = os.dup(2)
    os.close(2)
    try:
        with panics_unheard():
            pass
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def test_a_panic_of_the_decompressor_is_one_line(tmp_path, capfd) -> None:
    path = tmp_path / "a.laz"
    path.write_bytes(zlib.decompress(base64.b64decode(SYMBOL_OUT_OF_RANGE)))
    with pytest.raises(InputError, match="the LAS file is damaged") as told:
        read_cloud(str(path))
    assert type(told.value.__cause__).__name__ == "PanicException"
    assert capfd.readouterr().err == ""
