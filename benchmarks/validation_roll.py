"""The body that rolls: what the multi-body's springs make of it, and our own car's roll against theory.

Part of ``validation.py``, which prints it.
"""

import math
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from vse_gym.manoeuvres.base import DEG, KMH
from vse_gym.multibody import CARS, library_parameters
from vse_gym.physics import parameters as p
from vse_gym.physics.double_track import advance, rolling_start
from vse_gym.vehicles import load

NOTHING = np.zeros(4)
MOST = 1.0  # how far our own car's roll may be from theory [%]


def with_the_librarys_body(name: str) -> p.Vehicle:
    """A car of the library whose body rolls on the library's springs, in series with the tyres' under the axles."""
    q: Any = library_parameters(CARS[name])
    stiffness = damping = 0.0
    for track, spring, damper, bar in ((q.T_f, q.K_sf, q.K_sdf, q.K_tsf), (q.T_r, q.K_sr, q.K_sdr, q.K_tsr)):
        springs, tyres = 0.5 * track**2 * spring - bar, 0.5 * track**2 * q.K_zt  # N m/rad; bars are negative there
        given = tyres / (springs + tyres)  # share of the roll that is in the suspension
        stiffness += springs * given
        damping += 0.5 * track**2 * damper * given**2
    body = p.RollingBody(q.m_s, q.h_s - 0.5 * (q.h_raf + q.h_rar), q.I_Phi_s, q.I_xz_s, stiffness, damping)
    return p.check_vehicle(load(name)._replace(body=body))


def with_roll(console: Console, all_pairs: list[Any]) -> None:
    """Print the same of the plant with eight degrees of freedom.

    Not ay and sideslip: the multi-body gives them of a point that swings with the body, on joints that yield sideways.
    """
    compared = ("yaw rate", "roll")
    table = Table("car", "drive", "largest roll [deg]", *compared, title="The same, a body that rolls: NRMSE [%]")
    for pair in all_pairs:
        if pair.kind != "braking":
            cells = (f"{pair.nrmse(signal, rolling=True):.2f}" for signal in compared)
            table.add_row(pair.car, pair.kind, f"{pair.peak('roll'):.2f}", *cells)
    console.print(table)


def own_car(console: Console) -> bool:
    """Print roll gradient, frequency and damping of our own rolling car beside theory; whether they agree."""
    car = load("wei2019_roll")
    body, road = car.body, p.road((0.0, 0.9))
    swing = body.sprung_mass * body.roll_arm
    restoring = body.roll_stiffness - swing * p.GRAVITY
    x = advance(car, road, rolling_start(car, 80 * KMH), p.Inputs(0.02, NOTHING, NOTHING), 4000, 1e-3)
    gradient = x[p.ROLL] / (x[p.AY] / p.GRAVITY - math.sin(x[p.ROLL])) / DEG
    inertia = body.roll_inertia + swing * body.roll_arm - swing**2 / car.mass
    inertia -= body.roll_yaw_product**2 / car.yaw_inertia
    natural = math.sqrt(restoring / inertia)
    ratio = body.roll_damping / (2 * inertia * natural)
    frequency, seen_ratio = _swing(car)
    rows = (
        ("roll in a steady turn [deg/g]", gradient, swing * p.GRAVITY / restoring / DEG),
        ("frequency on ice, damped [Hz]", frequency, natural * math.sqrt(1 - ratio**2) / (2 * math.pi)),
        ("damping ratio on ice", seen_ratio, ratio),
    )
    good = True
    for what, seen, theory in rows:
        away = 100 * abs(seen / theory - 1)
        good &= away <= MOST
        verdict = "[green]ok" if away <= MOST else "[bold red]no"
        console.print(f"- wei2019_roll, {what}: {seen:.4f}, theory {theory:.4f} ({away:.2f} %, {verdict}[/])")
    return good


def _swing(car: p.Vehicle) -> tuple[float, float]:
    """Damped frequency [Hz] and damping ratio of the body let go on a road without friction, from its peaks."""
    x = rolling_start(car, 0.0)
    x[p.ROLL] = 0.1
    rates: list[float] = []
    rolls: list[float] = []
    for _ in range(3000):
        x = advance(car, p.road((0.0, 1e-9)), x, p.Inputs(0.0, NOTHING, NOTHING), 1, 1e-3)
        rates.append(x[p.ROLL_RATE])
        rolls.append(x[p.ROLL])
    rate, roll = np.array(rates), np.array(rolls)
    turns = np.flatnonzero(rate[:-1] * rate[1:] < 0)[:6]
    exact = turns + rate[turns] / (rate[turns] - rate[turns + 1])
    half = float(np.mean(np.diff(exact))) * 1e-3
    fall = float(np.mean(np.log(np.abs(roll[turns[:-1]] / roll[turns[1:]]))))
    return 0.5 / half, fall / math.hypot(math.pi, fall)
