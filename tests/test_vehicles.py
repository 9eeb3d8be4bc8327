"""Cars from their files: published figures, and refusals that say what is wrong."""

import math
import re
from pathlib import Path

import pytest

from vse_gym.manoeuvres.held_steer import HeldSteer
from vse_gym.manoeuvres.straight_driving import StraightDriving
from vse_gym.physics import parameters as p
from vse_gym.vehicles import FOLDER, load, names

CARS = names()
QIN = (FOLDER / "qin2014.toml").read_text(encoding="utf-8")
WRITTEN = [name for name in p.Vehicle._fields if name not in p.Vehicle._field_defaults]  # in a file
NUMBERS = [name for name in WRITTEN if not name.endswith("_tyre")]
SHARES = ["front_transfer", "front_drive"]
every_car = pytest.mark.parametrize("name", CARS)


def written(folder, text):
    """The path of a file with that text."""
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def numbers(vehicle):
    """Every number of a car."""
    return [*(getattr(vehicle, name) for name in NUMBERS), *vehicle.front_tyre, *vehicle.rear_tyre]


@every_car
def test_every_car_is_in_range_and_all_floats(name):
    vehicle = load(name)
    assert p.check_vehicle(vehicle) == vehicle
    assert {type(number) for number in numbers(vehicle)} == {float}


@every_car
def test_every_number_is_marked_published_or_chosen(name):
    for line in (FOLDER / f"{name}.toml").read_text(encoding="utf-8").splitlines():
        if "=" in line and not line.startswith(("#", "law")):
            assert re.search(r"# .*(published|chosen)", line), line


@every_car
def test_a_car_is_found_by_name_by_path_and_as_itself(name):
    vehicle = load(name)
    assert load(FOLDER / f"{name}.toml") == load(str(FOLDER / f"{name}.toml")) == load(vehicle) == vehicle


def test_a_file_of_ones_own_is_read(tmp_path):
    path = written(tmp_path, QIN.replace("mass = 1528.0", "mass = 1600.0"))
    assert load(path) == load(str(path)) == load("qin2014")._replace(mass=1600.0)


@pytest.mark.parametrize("name", ["beetle", "beetle.toml", Path("beetle"), ""])
def test_an_unknown_car_is_told_the_known_ones(name):
    with pytest.raises(KeyError) as refusal:
        load(name)
    assert all(known in str(refusal.value) for known in CARS)


@pytest.mark.parametrize("field", WRITTEN)
def test_a_missing_key_is_named(tmp_path, field):
    lines, skipping = [], False
    for line in QIN.splitlines():
        if line.startswith("["):
            skipping = line == f"[{field}]"
        if not skipping and line.partition("=")[0].strip() != field:
            lines.append(line)
    with pytest.raises(ValueError, match=field):
        load(written(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize("field", ["slip_stiffness", "cornering_stiffness", "law"])
def test_a_missing_key_of_a_tyre_is_named(tmp_path, field):
    front, rear = QIN.split("[rear_tyre]")
    rear = "\n".join(line for line in rear.splitlines() if not line.startswith(field))
    with pytest.raises(ValueError, match=rf"rear_tyre.*{field}"):
        load(written(tmp_path, f"{front}[rear_tyre]{rear}"))


def test_an_unknown_key_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"mine\.toml.*colour"):
        load(written(tmp_path, f'colour = "red"\n{QIN}'))
    with pytest.raises(ValueError, match=r"mine\.toml.*rear_tyre.*colour"):
        load(written(tmp_path, f'{QIN}\ncolour = "red"\n'))


def test_a_key_with_a_default_may_be_left_out(tmp_path):
    proportional = QIN.replace("cornering_stiffness = 34377.0", "cornering_stiffness = 34377.0\nreference_load = 3700")
    tyre = p.PolynomialTyre(120e3, 34377.0, 3700.0)
    assert load(written(tmp_path, proportional)) == load("qin2014")._replace(front_tyre=tyre, rear_tyre=tyre)


def test_a_file_may_give_the_tyres_relaxation_lengths(tmp_path):
    unsteady = f"relaxation_x = 0.15\nrelaxation_y = 0.45\n{QIN}"
    assert load(written(tmp_path, unsteady)) == load("qin2014")._replace(relaxation_x=0.15, relaxation_y=0.45)


@pytest.mark.parametrize("field", ["relaxation_x", "relaxation_y"])
@pytest.mark.parametrize("wrong", [-0.1, 0.01, 2.1, math.nan])
def test_a_relaxation_length_that_cannot_be_is_refused_by_name(field, wrong):
    lengths = {"relaxation_x": 0.15, "relaxation_y": 0.45, field: wrong}
    with pytest.raises(ValueError, match=field):
        load(load("qin2014")._replace(**lengths))


@pytest.mark.parametrize("field", ["relaxation_x", "relaxation_y"])
def test_tyres_relax_in_both_directions_or_in_none(field):
    with pytest.raises(ValueError, match=r"relaxation_x and relaxation_y must both"):
        load(load("qin2014")._replace(**{field: 0.3}))


@pytest.mark.parametrize("field", ["steering_offset", "radius_error"])
def test_a_file_does_not_say_how_one_very_car_differs(tmp_path, field):
    with pytest.raises(ValueError, match=rf"mine\.toml.*{field}"):
        load(written(tmp_path, f"{field} = 0.01\n{QIN}"))


def test_an_unknown_tyre_law_is_told_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match=r"front_tyre\.law") as refusal:
        load(written(tmp_path, QIN.replace("polynomial", "rubber", 1)))
    assert all(law in str(refusal.value) for law in p.TYRES)


@pytest.mark.parametrize("field", NUMBERS)
@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf, -math.inf])
def test_a_number_that_cannot_be_is_refused_by_name(field, wrong):
    with pytest.raises(ValueError, match=field):
        load(load("qin2014")._replace(**{field: wrong}))


MAGIC = p.MagicFormulaTyre(66909.0, 65760.0, 3000.0, 1.6, 1.3, 0.4, -0.1, 1.1, 1.0)
STIFFNESSES = ["slip_stiffness", "cornering_stiffness"]
WRONG_TYRES = [
    *((p.PolynomialTyre(1e5, 3e4), field, wrong) for field in STIFFNESSES for wrong in (-1.0, 0.0, math.nan)),
    *((p.PolynomialTyre(1e5, 3e4), "reference_load", wrong) for wrong in (-1.0, math.nan)),  # 0: at every load alike
    *((MAGIC, field, math.nan) for field in MAGIC._fields),
    *((MAGIC, field, 0.0) for field in [*STIFFNESSES, "reference_load", "peak_x", "peak_y"]),
    *((MAGIC, field, wrong) for field in ("shape_x", "shape_y") for wrong in (0.99, 2.0)),
    *((MAGIC, field, 1.01) for field in ("curvature_x", "curvature_y")),
    (p.FialaTyre(1e5, 3e4, 0.07), "trail", -0.01),
    *((p.DugoffTyre(1e5, 3e4), field, 0.0) for field in STIFFNESSES),
]


@pytest.mark.parametrize(("tyre", "field", "wrong"), WRONG_TYRES, ids=lambda v: getattr(type(v), "__name__", v))
def test_a_tyre_that_cannot_be_is_refused_by_name(tyre, field, wrong):
    vehicle = load("qin2014")._replace(rear_tyre=tyre)
    assert load(vehicle) == vehicle
    with pytest.raises(ValueError, match=rf"rear_tyre\.{field}"):
        load(vehicle._replace(rear_tyre=tyre._replace(**{field: wrong})))


@pytest.mark.parametrize("field", SHARES)
def test_a_share_lies_between_nothing_and_all(field):
    vehicle = load("qin2014")
    for share in (0.0, 1.0):
        assert getattr(load(vehicle._replace(**{field: share})), field) == share
    with pytest.raises(ValueError, match=field):
        load(vehicle._replace(**{field: 1.01}))


@pytest.mark.parametrize("field", sorted(set(NUMBERS) - {*SHARES, "height", "front_overhang", "rear_overhang"}))
def test_what_is_divided_by_must_not_be_zero(field):
    with pytest.raises(ValueError, match=field):
        load(load("qin2014")._replace(**{field: 0.0}))


def test_all_that_is_wrong_is_said_at_once():
    with pytest.raises(ValueError, match=r"mass.*lf"):
        load(load("qin2014")._replace(mass=-1.0, lf=math.nan))


def test_a_tyre_of_another_kind_is_refused():
    with pytest.raises(ValueError, match=r"front_tyre.*polynomial"):
        load(load("qin2014")._replace(front_tyre=(1.0, 2.0)))


def test_whole_numbers_become_floats(tmp_path):
    # An int among the floats would be another type to numba, and compile every kernel a second time.
    whole = QIN.replace("1528.0", "1528").replace("120e3", "120000").replace("16.0", "16")
    for vehicle in (load(written(tmp_path, whole)), load(load("qin2014")._replace(mass=1528, steering_ratio=16))):
        assert {type(number) for number in numbers(vehicle)} == {float}
        assert vehicle == load("qin2014")


def test_qin2014_is_as_published():
    vehicle = load("qin2014")
    published = p.Vehicle._fields[:7] + ("wheel_radius",)
    assert [getattr(vehicle, name) for name in published] == [1528, 2440, 1.48, 1.08, 0.432, 1.52, 1.594, 0.33]
    for tyre in (vehicle.front_tyre, vehicle.rear_tyre):
        assert tyre.slip_stiffness == 1200 * 100  # N per percent slip
        assert tyre.cornering_stiffness == pytest.approx(600 * 180 / math.pi, abs=0.5)  # N/deg, given to 1 N/rad


def test_qin2014_oversteers_and_has_a_critical_speed():
    vehicle = load("qin2014")
    # Three digits are quoted of either.
    assert vehicle.understeer_gradient == pytest.approx(-3.47e-3, abs=5e-6)
    assert math.degrees(vehicle.understeer_gradient) * p.GRAVITY == pytest.approx(-1.95, abs=5e-3)
    assert vehicle.critical_speed * 3.6 == pytest.approx(97.7, abs=0.05)


def test_the_sister_differs_in_her_rear_tyres_alone_and_understeers():
    vehicle, sister = load("qin2014"), load("qin2014_understeer")
    assert sister._replace(rear_tyre=vehicle.rear_tyre) == vehicle
    assert 2 * sister.rear_tyre.cornering_stiffness == pytest.approx(112165, abs=0.5)
    assert sister.understeer_gradient == pytest.approx(0.0015, abs=5e-5)
    assert sister.critical_speed == math.inf


@every_car
def test_the_critical_speed_is_where_the_yaw_gain_is_infinite(name):
    vehicle = load(name)
    if math.isfinite(vehicle.critical_speed):
        assert vehicle.wheelbase + vehicle.understeer_gradient * vehicle.critical_speed**2 == pytest.approx(0, abs=1e-9)
    else:
        assert vehicle.understeer_gradient >= 0


@every_car
def test_the_caps_stand_in_the_order_of_the_wheels(name):
    vehicle = load(name)
    front, rear = vehicle.brake_cap_front, vehicle.brake_cap_rear
    assert vehicle.brake_caps.tolist() == [front, front, rear, rear]


@pytest.mark.parametrize("friction", [0.0, -0.5, 2.1, math.nan, math.inf])
def test_a_friction_that_no_road_has_is_refused(friction):
    with pytest.raises(ValueError, match="friction"):
        p.road((0.0, friction))
    with pytest.raises(ValueError, match="friction"):
        p.road((0.0, 0.9), (10.0, friction))
    with pytest.raises(ValueError, match="friction"):
        StraightDriving(friction=friction)
    with pytest.raises(ValueError, match="friction"):
        HeldSteer(friction_after=friction)


@pytest.mark.parametrize("starts", [(), (1.0,), (0.0, 0.0), (0.0, 5.0, 4.0), (math.nan,), (0.0, math.nan)])
def test_segments_that_do_not_follow_each_other_are_refused(starts):
    with pytest.raises(ValueError, match="segments"):
        p.road(*((start, 0.9) for start in starts))


@pytest.mark.parametrize("field", ["speed", "duration"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_a_drive_that_goes_nowhere_is_refused(field, wrong):
    with pytest.raises(ValueError, match=field):
        StraightDriving(**{field: wrong})


def test_a_road_is_the_same_on_both_sides_and_of_one_slope_and_bank():
    road = p.road((0.0, 0.9), (50.0, 0.3), slope=0.02, bank=-0.01)
    assert road.start.tolist() == [0, 50]
    assert road.friction_left.tolist() == road.friction_right.tolist() == [0.9, 0.3]
    assert road.slope.tolist() == [0.02] * 2
    assert road.bank.tolist() == [-0.01] * 2
