"""The closed loop with the multi-body car as its plant: the same blocks, the same rules."""

import copy
import math
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from typer.testing import CliRunner

from vse_gym import cli, multibody
from vse_gym.evaluation import Cell, Randomise
from vse_gym.physics import parameters as p
from vse_gym.registry import UnknownNameError
from vse_gym.scenarios import scenario
from vse_gym.simulation import Simulation, rollout
from vse_gym.vehicles import load

DEG = math.pi / 180
MULTIBODY = {"vehicle": "bmw_320i", "plant": "commonroad_mb"}
SHORT = {"duration": 1.0, "begin": 0.1, "amplitude": 60 * DEG}
WHOLE_LOG = ("truth", "inputs", "readings", "estimate", "brake", "added", "nis")


@pytest.fixture(scope="module")
def short():
    return scenario("held_steer", **MULTIBODY, **SHORT)


def test_the_same_seed_gives_the_same_drive_bit_for_bit(short):
    once, again, other = (rollout(short, "ekf", "esc", seed) for seed in (3, 3, 4))
    for field in WHOLE_LOG:
        assert getattr(once, field).tobytes() == getattr(again, field).tobytes(), field
    assert once.readings.tobytes() != other.readings.tobytes()


def test_a_drive_starts_anew_after_another(short):
    simulation, fresh = Simulation(short, "ekf"), Simulation(short, "ekf")
    simulation.reset(1)
    for _ in range(50):
        simulation.step()
    frames = [(s.reset(2), s.step(), s.step())[-1] for s in (simulation, fresh)]
    assert frames[0].truth.state.tobytes() == frames[1].truth.state.tobytes()
    assert frames[0].reading.y.tobytes() == frames[1].reading.y.tobytes()


def test_a_copy_made_in_mid_drive_goes_on_alike(short):
    simulation = Simulation(short, "ekf")
    simulation.reset(1)
    for _ in range(30):
        simulation.step()
    twin = copy.deepcopy(simulation)
    states = [[s.step().truth.state.tobytes() for _ in range(20)] for s in (simulation, twin)]
    assert states[0] == states[1]


def test_readings_are_the_projected_truth_when_sensors_are_clean(short):
    clean = scenario("held_steer", sensors="clean", **MULTIBODY, **SHORT)
    log = rollout(clean, "truth", "none", 0)
    np.testing.assert_array_equal(log.readings[:, :3], log.truth[:, [p.AX, p.AY, p.YAW_RATE]])
    np.testing.assert_array_equal(log.readings[:, 3:7], log.truth[:, p.WHEEL_SPEEDS])
    assert log.truth[-1, p.AY] > 3 and log.truth[-1, p.ROLL] > 0.03


@pytest.mark.parametrize("name", ["bmw_320i", "vw_vanagon"])
def test_the_stability_control_holds_a_car_that_slides_without_it(name):
    # Gains as they were found on the double track. 100 deg of hand wheel, friction 0.8: 44 and 78 deg without control.
    drive = scenario("sine_with_dwell", name, "clean", plant="commonroad_mb", amplitude=100 * DEG, friction=0.8)
    free, held = (rollout(drive, "truth", law, 0) for law in ("none", "esc"))
    assert math.degrees(free.peak_sideslip) > 40
    assert math.degrees(held.peak_sideslip) < 4 and not held.ended
    assert drive.manoeuvre.judge(held, drive.nominal).passed


def test_a_slide_that_the_library_cannot_follow_ends_the_drive_with_its_last_state():
    drive = scenario("sine_with_dwell", **MULTIBODY, amplitude=100 * DEG, friction=0.8, sensors="clean")
    log = rollout(drive, "truth", "none", 0)
    assert log.ended == "beyond the multi-body model"  # at 2 m/s, 78 deg across, its inner wheels go backwards
    assert np.isfinite(log.truth).all() and log.peak_sideslip > 70 * DEG


def test_a_study_s_cell_drives_it_with_the_mass_and_stiffness_that_were_drawn():
    cell = Cell("mb", "sine_with_dwell", **MULTIBODY)
    drawn = cell.scenario(Randomise(mass=(1.1, 1.2), stiffness=(0.8, 0.9), friction=0.1), seed=1)
    plant, car = drawn.multibody(), load("bmw_320i")
    assert 1.1 * 1093.3 < plant.library.m < 1.2 * 1093.3
    ratio = drawn.vehicle.front_tyre.cornering_stiffness / car.front_tyre.cornering_stiffness
    assert 0.8 < ratio < 0.9
    assert plant.library.tire.p_ky1 == pytest.approx(ratio * multibody.library_parameters(2).tire.p_ky1)


def test_gymnasium_s_checker_has_nothing_to_say():
    check_env(gymnasium.make("vse_gym/SineWithDwell-v0", **MULTIBODY).unwrapped)


def test_an_unknown_plant_is_told_the_known_ones():
    with pytest.raises(UnknownNameError, match="no plant named 'carsim'; known: double_track, commonroad_mb"):
        scenario("held_steer", plant="carsim")


def test_a_missing_library_is_a_sentence_that_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "vehiclemodels.vehicle_dynamics_mb", None)
    multibody._dynamics.cache_clear()
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'vse-gym\[multibody\]'"):
        scenario("held_steer", **MULTIBODY)
    result = CliRunner().invoke(cli.app, ["run", "held_steer", "--plant", "commonroad_mb", "--vehicle", "bmw_320i"])
    assert result.exit_code == 2 and "vse-gym[multibody]" in " ".join(result.output.split())


def test_the_command_line_drives_it():
    words = ["run", "straight_driving", "--plant", "commonroad_mb", "--vehicle", "ford_escort", "--estimator", "truth"]
    result = CliRunner().invoke(cli.app, words)
    assert result.exit_code == 0 and "passed" in result.output


def test_the_command_line_refuses_another_car_with_the_choices():
    result = CliRunner().invoke(cli.app, ["run", "held_steer", "--plant", "commonroad_mb"])
    assert result.exit_code == 2 and "bmw_320i" in " ".join(result.output.split())
