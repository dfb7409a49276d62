"""The harness itself: which mistakes it makes, that a guard notices one, and that it tells when none does."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import types
from pathlib import Path

import pytest

from tests.mutation.equivalent import read_equivalent
from tests.mutation.guards import GROUPS
from tests.mutation.ledger import Ledger
from tests.mutation.mistakes import altered, mistakes
from tests.mutation.patch import exchange_code
from tests.mutation.run import path_of

GUARDS = [guard for guards in GROUPS.values() for guard in guards]


def after(line: str, *, borders: bool = False) -> set[str]:
    """What the mistakes make of a line."""
    return {mistake.after.replace("(", "").replace(")", "") for mistake in mistakes(line, borders=borders)}


def test_an_operator_is_another_one_or_leaves_a_term_out() -> None:
    assert after("y = a + b") == {"y = a - b", "y = a", "y = b"}
    assert after("y = a / b") == {"y = a * b", "y = a"}
    assert after("y -= a") == {"y += a", "pass"}
    assert after("y = -a") == {"y = a"}


def test_a_comparison_is_turned_round_and_shifted_where_numbers_tie() -> None:
    assert after("y = a < b") == {"y = a >= b"}
    assert after("y = a < b", borders=True) == {"y = a >= b", "y = a <= b"}
    assert after("y = a and b") == {"y = a or b"}
    assert after("if f: pass") == {"if not f: pass"}


def test_a_constant_is_another_one_and_a_function_its_counterpart() -> None:
    assert after("y = 2") == {"y = 3"}
    assert after("y = 0.0") == {"y = 1.0"}
    assert after("y = 0.5") == {"y = 1.0"}
    assert after("y = min(a, b)") == {"y = maxa, b"}
    assert after("y = math.log(a)") == {"y = a"}
    assert after("f(a)") == {"pass"}


def test_lines_that_are_alike_are_told_apart() -> None:
    found = mistakes("a -= 1\nif b:\n    a -= 1\n", borders=False)
    turned = [one for one in found if one.after == "a += 1"]
    assert [str(one).partition(" -> ")[2] for one in turned] == ["a += 1 (line 1 of those alike)", "a += 1"]
    assert [one.start for one in turned] == sorted({one.start for one in turned})


def test_what_makes_no_number_is_left_alone() -> None:
    source = '"""Two: 2."""\n\nimport a\n\n\n@jit(cache=True)\ndef f(a: A[2]) -> B[3]:\n    raise E(f"{a + 2}")\n'
    assert mistakes(source, borders=True) == []
    assert after("return False, 0.0") == {"return True, 0.0"}


def test_a_source_has_one_guard() -> None:
    assert len({guard.module for guard in GUARDS}) == len(GUARDS)


@pytest.mark.parametrize("guard", GUARDS, ids=[guard.module for guard in GUARDS])
def test_each_mistake_alters_its_source_in_one_place(guard) -> None:
    source = path_of(guard.module).read_text()
    found = mistakes(source, borders=guard.borders)
    assert len(found) == len({str(mistake) for mistake in found}) > 10
    tree = ast.dump(ast.parse(source))
    for mistake in found[::10]:
        assert ast.dump(ast.parse(altered(source, mistake))) != tree, str(mistake)


@pytest.mark.parametrize("guard", GUARDS, ids=[guard.module for guard in GUARDS])
def test_the_list_of_harmless_mistakes_is_not_out_of_date(guard) -> None:
    possible = {str(mistake) for mistake in mistakes(path_of(guard.module).read_text(), borders=guard.borders)}
    known = read_equivalent(guard.module)
    assert set(known) <= possible
    assert all(known.values())


TINY = """
from tests.mutation.guards import Guard
from tests.mutation.run import path_of, run_guard, warm
from pathlib import Path
guard = Guard("prf.kernels.laser", ("tests/kernels/test_laser.py::test_it_is_the_written_one[defaults-0.3]",))
source = path_of(guard.module).read_text()
wrong = source.replace("z = (reading - distance) / s", "z = (reading + distance) / s")
harmless = source.replace("z * z", "z ** 2")
assert source != wrong and source != harmless
for text in (source, wrong, harmless):
    print(run_guard(guard, text, 60.0, Path("unused")).survived)
print(run_guard(guard, "while True: pass", 1.0, Path("unused")).survived)
"""


def test_a_guard_fails_on_a_mistake_and_passes_where_nothing_changed(project_root: Path) -> None:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(project_root)}
    done = subprocess.run(
        [sys.executable, "-c", TINY], env=environment, cwd=project_root, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["True", "False", "True", "False"], done.stderr


def test_a_mistake_is_made_in_a_function_that_is_imported_and_nowhere_else(monkeypatch: pytest.MonkeyPatch) -> None:
    source = (
        "LIMIT = 3\n\n\nclass A:\n    def f(self, x=1):\n        return x + 2\n\n\ndef g(x):\n    return A().f(x) * 2\n"
    )
    module = types.ModuleType("imported")
    exec(compile(source, "imported", "exec"), module.__dict__)
    monkeypatch.setitem(sys.modules, "imported", module)
    found = {mistake.after: mistake for mistake in mistakes(source, borders=False)}
    assert not exchange_code("imported", source, found["LIMIT = 4"])
    assert not exchange_code("imported", source, found["def f(self, x=2):"])
    assert module.g(5) == 14
    assert exchange_code("imported", source, found["return (x - 2)"])
    assert module.g(5) == 6
    assert exchange_code("imported", source, found["return A().f(x) * 3"])
    assert module.g(5) == 9


def test_what_was_noticed_is_not_tried_again_while_its_source_stands(tmp_path: Path) -> None:
    path = tmp_path / "build" / "ledger.jsonl"
    ledger = Ledger(path)
    ledger.note("a", "source", "x -> y", "survived", "")
    ledger.note("a", "source", "x -> z", "killed", "test")
    ledger.note("b", "source", "x -> y", "killed", "test")
    assert Ledger(path).killed("a", "source") == {"x -> z"}
    ledger.note("a", "source", "x -> y", "killed", "a new test")
    assert Ledger(path).killed("a", "source") == {"x -> y", "x -> z"}
    assert Ledger(path).killed("a", "another") == set()
    assert Ledger(path, anew=True).killed("a", "source") == set()
