"""The truth stays in the plant: an estimator is handed readings and what it is told, and no way to anything else."""

import gc
from dataclasses import dataclass, field
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType, SimpleNamespace

import numpy as np
import pytest

import vse_gym.sensors
import vse_gym.simulation
from vse_gym.catalogue import CONTROLLERS, ESTIMATORS
from vse_gym.estimators.base import Estimator
from vse_gym.listener import Listener
from vse_gym.manoeuvres.base import Manoeuvre
from vse_gym.physics.parameters import Road
from vse_gym.scenarios import Scenario, scenario
from vse_gym.sensors import SUITES, NoiseRecord, Sensors
from vse_gym.simulation import Simulation
from vse_gym.types import Car, Driver, Estimate

STEPS = 150
PLANT = (Simulation, Scenario, Manoeuvre, Road, Sensors, NoiseRecord, Listener, Car, Driver)


def reachable(*handed):
    """Every object that can be reached from some, but for what all code can reach: modules, classes, functions.

    A function's closure and defaults are followed, as is what a bound method is bound to: an object could hide there.
    """
    seen, waiting = {}, list(handed)
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen or isinstance(thing, ModuleType | type):
            continue
        seen[id(thing)] = thing  # kept alive too, so that no other object gets its id
        if isinstance(thing, FunctionType):
            waiting += [cell.cell_contents for cell in thing.__closure__ or ()]
            waiting += [*(thing.__defaults__ or ()), *(thing.__kwdefaults__ or {}).values()]
        elif isinstance(thing, MethodType | BuiltinFunctionType):
            waiting += [thing.__self__, getattr(thing, "__func__", None)]
        elif isinstance(thing, np.ndarray):  # which shows its insides to no garbage collector
            waiting += [thing.base, *(thing.ravel().tolist() if thing.dtype == object else [])]
        else:
            waiting += gc.get_referents(thing)
    return list(seen.values())


@dataclass(frozen=True)
class Spy(Estimator):
    """Looks around in everything that it is handed, and keeps it."""

    handed: list = field(default_factory=list)

    def init(self, nominal, rng):
        self.handed.append((nominal, rng))
        return nominal

    def update(self, state, reading, rng):
        self.handed.append((reading, rng))
        return state

    def estimate(self, state):
        return Estimate(state.speed)


@pytest.fixture(scope="module")
def spied():
    """A drive with a spy in the loop: the simulation, and after each step what the spy had been handed till then."""
    simulation = Simulation(scenario("sine_with_dwell", sensors="dropout"), Spy())
    law = CONTROLLERS.make("esc")
    state, frame = law.init(simulation.scenario.nominal), simulation.reset(1)
    plant = [arrays_of(simulation)]
    for _ in range(STEPS):
        demand, state = law.act(state, frame.estimate, frame.reading)
        frame = simulation.step(demand)
        plant.append(arrays_of(simulation))
    return simulation, simulation.estimator.handed, plant


def arrays_of(simulation):
    """The arrays that an estimator must not see as they are: state, brakes, what will happen to the readings."""
    record = [thing for thing in simulation.record if isinstance(thing, np.ndarray)]
    return [simulation.state, simulation.frame.brake, *record]


def test_nothing_of_the_plant_can_be_reached_from_what_an_estimator_is_handed(spied):
    simulation, handed, plant = spied
    secret = {id(array) for arrays in plant for array in arrays} | {id(simulation), id(simulation.listener)}
    for thing in reachable(handed):
        assert not isinstance(thing, PLANT), f"{type(thing).__name__} can be reached"
        assert id(thing) not in secret, f"{thing} can be reached"


def test_nothing_handed_to_an_estimator_shares_memory_with_the_plant(spied):
    _, handed, plant = spied
    arrays = [thing for thing in reachable(handed) if isinstance(thing, np.ndarray)]
    assert len(arrays) >= 2 * STEPS  # else the search found too little
    before_and_after = [array for arrays in plant for array in arrays[:2]] + plant[0][2:]
    for array in arrays:
        assert not any(np.shares_memory(array, hidden) for hidden in before_and_after if array.size)


class Leak:
    """Ways in which the plant could be handed out by mistake."""

    def as_an_attribute(self):
        return SimpleNamespace(plant=self)

    def in_a_closure(self):
        return lambda: self

    def as_a_bound_method(self):
        return self.in_a_closure

    def in_an_object_array(self):
        return np.array([self], dtype=object)

    def as_a_default(self):
        def function(plant=self):
            return plant

        return function

    def deep_inside(self):
        return {"a": [({"b": iter([self])},)]}


@pytest.mark.parametrize("way", [name for name in vars(Leak) if not name.startswith("_")])
def test_the_search_would_find_a_leak(way):
    leak = Leak()
    assert any(thing is leak for thing in reachable(getattr(leak, way)()))


def test_the_search_would_find_a_view_of_an_array():
    state = np.zeros(16)
    assert any(thing is state for thing in reachable((state[3:5],)))


# -- the same luck for everybody --------------------------------------------------------------------------------------


def in_shadow(estimator, seed=1, suite="cauchy_gaussian"):
    """Record and readings of a drive in which nobody acts on the estimate."""
    simulation = Simulation(scenario("sine_with_dwell", sensors=suite), estimator)
    frames = [simulation.reset(seed)]
    frames += [simulation.step() for _ in range(STEPS)]
    return simulation.record, np.array([np.concatenate([f.reading.inputs, f.reading.y]) for f in frames])


def in_the_loop(estimator, seed=1):
    """Record of a drive that the stability control steers by the estimate, and the path that the car took."""
    simulation = Simulation(scenario("sine_with_dwell", sensors="cauchy_gaussian"), estimator)
    law = CONTROLLERS.make("esc")
    state, frame = law.init(simulation.scenario.nominal), simulation.reset(seed)
    for _ in range(STEPS):
        demand, state = law.act(state, frame.estimate, frame.reading)
        frame = simulation.step(demand)
    return simulation.record, simulation.state


@pytest.mark.parametrize("name", ESTIMATORS)
def test_in_shadow_every_estimator_has_the_same_readings(name):
    np.testing.assert_array_equal(in_shadow(name)[1], in_shadow("truth")[1])


@pytest.mark.parametrize("name", ESTIMATORS)
def test_in_the_loop_every_estimator_meets_the_same_noise(name):
    record, state = in_the_loop(name)
    expected, path = in_the_loop("truth")
    for array, same in zip(record, expected, strict=True):
        np.testing.assert_array_equal(array, same)
    assert ESTIMATORS[name] is ESTIMATORS["truth"] or not np.array_equal(state, path)  # though its car goes elsewhere


@pytest.mark.parametrize("suite", SUITES)
def test_another_seed_is_another_record(suite):
    one, other = (SUITES[suite].record(500, 0.01, seed) for seed in (1, 2))
    luck = [not np.array_equal(a, b) for a, b in zip(one, other, strict=True)]
    assert any(luck) or not SUITES[suite].noise


@pytest.mark.parametrize("suite", SUITES)
def test_the_estimators_generator_is_nobody_elses(suite, monkeypatch):
    # Every stream of a run is made by this function: the sensors' and the estimator's.
    made, original = {}, vse_gym.sensors.stream

    def stream(seed, name):
        assert name not in made, f"{name} is drawn from twice"
        made[name] = original(seed, name)
        return original(seed, name)

    monkeypatch.setattr(vse_gym.sensors, "stream", stream)
    monkeypatch.setattr(vse_gym.simulation, "stream", stream)
    spy = Spy()
    Simulation(scenario("sine_with_dwell", sensors=suite), spy).reset(1)
    (_, rng), *_ = spy.handed
    mine = rng.random(1000)
    np.testing.assert_array_equal(mine, made.pop("estimator").random(1000))
    assert {"sensors/inputs", "sensors/noise"} <= made.keys()  # and what a suite's own troubles draw
    for name, other in made.items():
        assert not np.isin(mine, other.random(1000)).any(), name  # nor a part of it, displaced


def test_a_stream_is_the_same_in_every_process_and_version():
    # Frozen: a change here changes every published result.
    first = vse_gym.sensors.stream(1, "estimator").bit_generator.random_raw(2)
    assert first.tolist() == [15005831401394124913, 1886380870400746980]


def test_neighbouring_seeds_and_names_share_nothing():
    streams = [vse_gym.sensors.stream(seed, name) for seed in (1, 11, 111) for name in ("1", "11", "estimator")]
    draws = np.array([stream.random(100) for stream in streams])
    assert np.unique(draws).size == draws.size
