"""Generics pick their body by type, and no cached machine code outlives the source it was made of."""

import copy
import json
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import vse_gym.compiled as machinery
from vse_gym.compiled import compiled, generic, hold
from vse_gym.inference.gaussian import Unscented

PACKAGE = Path(machinery.__file__).parent


class Circle(NamedTuple):
    radius: float


class Square(NamedTuple):
    side: float


class Blob(NamedTuple):
    size: float


@generic
def area(shape, scale):
    """Area of a shape, scaled."""


@compiled
def doubled(shape, scale):
    return 2 * area(shape, scale)


@pytest.fixture
def shapes(monkeypatch):
    """``area`` with two bodies; the package's own kernels keep the cache folder they had."""
    monkeypatch.setattr(machinery, "_dispatchers", [])
    monkeypatch.setattr(machinery, "_digest", machinery._digest)
    area.register(Circle)(compiled(lambda shape, scale: scale * np.pi * shape.radius**2))
    area.register(Square)(compiled(lambda shape, scale: scale * shape.side**2))
    yield area
    area.bodies.clear()


def test_a_generic_picks_its_body_by_the_type_of_its_first_argument(shapes):
    assert shapes(Circle(2.0), 3.0) == pytest.approx(12 * np.pi)
    assert shapes(Square(2.0), 3.0) == 12.0


def test_a_generic_picks_its_body_inside_a_kernel_too(shapes):
    assert doubled(Circle(2.0), 3.0) == pytest.approx(24 * np.pi)
    assert doubled(Square(2.0), 3.0) == 24.0


@pytest.mark.parametrize("call", [area, doubled], ids=["in Python", "in a kernel"])
def test_a_type_without_a_body_is_refused_and_those_with_one_are_named(shapes, call):
    with pytest.raises(TypeError, match=r"area\(\) is not registered for Blob; known: Circle, Square"):
        call(Blob(1.0), 1.0)


def test_a_generic_keeps_the_name_and_the_text_of_its_declaration():
    assert area.__name__ == "area"
    assert area.__doc__ == "Area of a shape, scaled."


def test_registering_a_foreign_model_moves_the_cache(shapes):
    before = machinery.cache_folder()
    shapes.register(Blob)(compiled(lambda shape, scale: scale * shape.size))
    assert machinery.cache_folder() != before


def test_a_model_that_is_typed_in_and_has_no_file_can_be_registered(shapes):
    typed = {"compiled": compiled}
    exec(compile("@compiled\ndef body(shape, scale): return scale * shape.size", "<stdin>", "exec"), typed)
    shapes.register(Blob)(typed["body"])
    assert shapes(Blob(2.0), 3.0) == 6.0


@pytest.mark.parametrize("place", ["a file", "below a file"])
def test_a_kernel_compiles_where_no_cache_can_be_written(place, tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("VSE_GYM_CACHE", str(blocked if place == "a file" else blocked / "below"))
    monkeypatch.setattr(machinery, "_dispatchers", [])
    monkeypatch.setattr(machinery, "_PACKAGE", Path(__file__).parent)  # so that the kernel here counts as ours

    @compiled
    def successor(x):
        return x + 1.0

    assert successor(1.0) == 2.0


def test_only_old_folders_of_its_own_making_are_thrown_away(tmp_path, monkeypatch):
    # VSE_GYM_CACHE may be any folder, with anything else in it.
    monkeypatch.setenv("VSE_GYM_CACHE", str(tmp_path))
    old, new, foreign = (tmp_path / f"kernels-{name}" for name in ("0123456789abcdef", "fedcba9876543210", "of-linux"))
    for folder in (old, new, foreign):
        folder.mkdir()
        (folder / "file").write_text("")
    for folder in (old, foreign):
        os.utime(folder, (0, 0))
    machinery._forget_old_code()
    assert not old.exists()
    assert new.exists()
    assert foreign.exists()


# -- constants that compiled code holds -------------------------------------------------------------------------------


@compiled
def spread(held):
    rule, points = held.value
    return rule.alpha * points.sum()


# Of the package's own types: kernels for them may stay in the package's cache.
CONSTANTS = Unscented(alpha=0.5), np.array([1.0, 2.0])


def test_what_is_held_arrives_in_a_kernel():
    assert spread(hold(CONSTANTS)) == 1.5


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda held: pickle.loads(pickle.dumps(held))])
def test_what_is_held_can_be_copied_and_saved(again):
    held = again(hold(CONSTANTS))
    assert held.value[0] == CONSTANTS[0]
    np.testing.assert_array_equal(held.value[1], CONSTANTS[1])
    assert spread(held) == 1.5


# -- across processes: a copy of the package with two kernel files of its own, one of which calls the other ------------

INNER = """
from vse_gym.compiled import compiled, generic

@generic
def weigh(model, x):
    "Declared here; the foreign model has a body."

@compiled
def inner(x):
    return {factor} * x
"""

OUTER = """
from vse_gym.compiled import compiled
from vse_gym.inner import inner, weigh

@compiled
def outer(x):
    return 1.0 + inner(x)

@compiled
def weigh_twice(model, x):
    return 2.0 * weigh(model, x)
"""

FOREIGN = """
from typing import NamedTuple
from vse_gym.compiled import compiled
from vse_gym.inner import weigh

class Foreign(NamedTuple):
    scale: float

@weigh.register(Foreign)
@compiled
def _(model, x):
    return {factor} * model.scale * x
"""

PLAIN = """
import json
from vse_gym.compiled import cache_folder
from vse_gym.outer import outer
value = outer(1.0)
print(json.dumps([value, str(cache_folder()), sum(outer.stats.cache_hits.values())]))
"""

WITH_MODEL = """
import json
from vse_gym.compiled import cache_folder
from vse_gym.outer import weigh_twice
from foreign import Foreign
value = weigh_twice(Foreign(1.0), 1.0)
print(json.dumps([value, str(cache_folder()), sum(weigh_twice.stats.cache_hits.values())]))
"""


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A folder with a copy of the package in it and, beside it, a place for the cache."""
    folder = tmp_path_factory.mktemp("copied")
    shutil.copytree(PACKAGE, folder / "vse_gym", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "vse_gym" / "outer.py").write_text(OUTER)
    return folder


def run(script, folder, **environment):
    """What a script prints, as JSON, run by a Python of its own that finds ``folder`` first."""
    variables = os.environ | {"PYTHONPATH": str(folder), "NUMBA_DISABLE_JIT": "0"} | environment
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], env=variables, cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def run_copy(script, folder):
    return run(script, folder, VSE_GYM_CACHE=str(folder / "cache"))


def test_an_edit_of_a_called_file_is_seen_and_no_edit_is_read_from_the_cache(copied):
    # Plain njit(cache=True) goes on with the old machine code of ``outer``, which lies in a file that did not change.
    (copied / "vse_gym" / "inner.py").write_text(INNER.format(factor="2.0"))
    value, folder, _ = run_copy(PLAIN, copied)
    assert value == 3.0
    again, same_folder, hits = run_copy(PLAIN, copied)
    assert (again, same_folder, hits) == (3.0, folder, 1)
    (copied / "vse_gym" / "inner.py").write_text(INNER.format(factor="5.0"))
    after, other_folder, hits = run_copy(PLAIN, copied)
    assert (after, hits) == (6.0, 0)
    assert other_folder != folder


def test_an_edit_of_a_foreign_model_is_seen_and_no_edit_is_read_from_the_cache(copied):
    (copied / "vse_gym" / "inner.py").write_text(INNER.format(factor="2.0"))
    (copied / "foreign.py").write_text(FOREIGN.format(factor="3.0"))
    value, folder, _ = run_copy(WITH_MODEL, copied)
    assert value == 6.0
    again, same_folder, hits = run_copy(WITH_MODEL, copied)
    assert (again, same_folder, hits) == (6.0, folder, 1)
    (copied / "foreign.py").write_text(FOREIGN.format(factor="4.0"))
    after, other_folder, hits = run_copy(WITH_MODEL, copied)
    assert (after, hits) == (8.0, 0)
    assert other_folder != folder


HOLDS_ITS_OWN = """
from typing import NamedTuple
from vse_gym.compiled import hold

class Mine(NamedTuple):
    x: float

def value():
    return hold(Mine(1.0)).value.x
"""

HOLDS_OURS = """
import json
from vse_gym.compiled import hold
from vse_gym.inference.gaussian import Extended
print(json.dumps(hold(Extended(1.0)).value.step))
"""


def test_one_programs_types_do_not_stop_another_program_that_shares_the_cache(copied):
    # The cache's index names the types that a kernel was compiled for; the other program cannot import ``mine``.
    (copied / "mine.py").write_text(HOLDS_ITS_OWN)
    assert run_copy("import mine; print(mine.value())", copied) == 1.0
    (copied / "mine.py").unlink()
    assert run_copy(HOLDS_OURS, copied) == 1.0


def test_a_foreign_model_may_move_to_another_module(copied):
    # The same text under another name: the digest of the file is the same, the name in the cache's index is not.
    (copied / "vse_gym" / "inner.py").write_text(INNER.format(factor="2.0"))
    (copied / "foreign.py").write_text(FOREIGN.format(factor="7.0"))
    assert run_copy(WITH_MODEL, copied)[0] == 14.0
    (copied / "foreign.py").rename(copied / "moved.py")
    assert run_copy(WITH_MODEL.replace("from foreign", "from moved"), copied)[0] == 14.0


DIVISION = """
import json
from vse_gym.compiled import compiled
reciprocal = compiled(eval("lambda x: 1.0 / x"))
print(json.dumps(reciprocal(0.0)))
"""


def test_a_kernel_divides_by_zero_as_ieee_has_it(copied):
    assert run_copy(DIVISION, copied) == np.inf


# -- without the compiler ---------------------------------------------------------------------------------------------

FILTERS = """
import json
import numpy as np
from vse_gym.catalogue import ESTIMATORS
from vse_gym.models import Nominal
from vse_gym.sensors import LOUD
from vse_gym.types import Reading
from vse_gym.vehicles import load

car = load("qin2014_understeer")
nominal = Nominal(car, LOUD, 20.0)
u = np.array([0.03, 0.0, 400.0, 0.0, 200.0, 50.0, 50.0, 0.0, 0.0])
y = np.array([-0.5, 3.0, 0.15, 60.0, 61.0, np.nan, 61.5, np.nan, np.nan, np.nan])
found = {}
for name, settings in (("ekf", {}), ("ukf", {}), ("kinematic", {}), ("pf", {"size": 20})):
    estimator, rng = ESTIMATORS.make(name, **settings), np.random.default_rng(1)
    state = estimator.init(nominal, rng)
    for k in range(5):
        state = estimator.update(state, Reading(0.01 * k, u, y), rng)
    estimate = estimator.estimate(state)
    found[name] = [*estimate[:5], *np.nan_to_num(estimate.cov).ravel()]
print(json.dumps(found))
"""


def test_without_the_compiler_the_kernels_say_the_same():
    # The same operations in the same order; only the last bits of libm's and fused operations may differ.
    with_compiler = run(FILTERS, PACKAGE.parent)
    without = run(FILTERS, PACKAGE.parent, NUMBA_DISABLE_JIT="1")
    for name, expected in with_compiler.items():
        np.testing.assert_allclose(without[name], expected, rtol=1e-12, atol=1e-12, err_msg=name)
