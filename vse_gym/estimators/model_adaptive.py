"""Model-adaptive particle filters: tunings of :mod:`vse_gym.inference.model_adaptive`."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vse_gym.estimators.base import Estimator
from vse_gym.estimators.particle import cauchy_shares
from vse_gym.inference.autoregression import AutoregressionTuning, autoregressions
from vse_gym.inference.model_adaptive import ModelAdaptive, Swarm, adaptive_step
from vse_gym.inference.particle import draw
from vse_gym.inference.wavelet import DONOHO, PRINTED, noise_level
from vse_gym.models import DataSheet, DoubleTrackTuning, ModelTuning, Nominal
from vse_gym.models.tuning import check_channels, check_range, tunable
from vse_gym.noise import contamination
from vse_gym.types import CHANNELS, Array, Estimate, Reading

GAINS = ("least_squares", "printed")
STARTS = ("least_squares", "hold")
CONSTANTS = {"donoho": DONOHO, "printed": PRINTED}

# The process noise is the least that a particle is moved by, whatever the autoregression has learnt; errors are added
# to what the wavelets hear, for they hear noise and not what the model of the tyres gets wrong. Found by hand on
# slaloms and sines with dwell. An autoregression needs more noise than a model of the car, which sees the driver.
TUNING = DoubleTrackTuning(
    vx_noise=0.3, vy_noise=0.6, yaw_noise=0.3, ax_error=1.0, ay_error=0.5, yaw_rate_error=0.01, wheel_error=0.1
)
PHYSICS_TUNING = DoubleTrackTuning(
    vx_noise=0.3, vy_noise=0.1, yaw_noise=0.1, ax_error=1.0, ay_error=3.0, yaw_rate_error=0.01, wheel_error=0.1
)


def sheet_variances(sheet: DataSheet) -> Array:
    """What the data sheet says of each channel's noise, (10,); NaN: not on board."""
    inertial = (sheet.acceleration, sheet.acceleration, sheet.yaw_rate)
    return np.square([*inertial, *4 * [sheet.wheel_speed], sheet.speed, sheet.sideslip, sheet.roll_rate])


class Adapted(NamedTuple):
    """Particles with what they have learnt, and what is reported of them."""

    fixed: ModelAdaptive
    swarm: Swarm
    cov: Array  # (n, n), of the weighted sample before resampling
    output: Array  # vx, vy, yaw rate, ax, ay, effective sample size, (6,)


@dataclass(frozen=True)
class ModelAdaptiveParticleFilter(Estimator):
    """A bootstrap filter whose particles move by autoregressions that follow the drive. Qin, Li, Li, Cao (2014).

    Nothing of the car is in the transition; tyres come in with the measurement alone. Each channel's noise is heard in
    real time by wavelets, and the likelihood expects heavy tails. vx, vy and yaw rate have an autoregression each; ax,
    ay and sideslip follow from them. The noise of the transition, which the print leaves open, is what the
    autoregressions leave unexplained, and at least the model's process noise. It knows of no brake: while all wheels
    are near locking it believes the car to go on, and ``mapf_physics`` does not.

    Raises:
        ValueError: If a number is out of range, or a name is not known.
    """

    model: ModelTuning = TUNING
    size: int = 500  # N
    order: int = 3  # p
    coefficient: float = tunable(0.01, 1e-3, 0.03)  # update coefficient UC of the autoregressions [-]
    gain: str = "least_squares"  # or "printed", which is no least squares and depends on the units
    start: str = "least_squares"  # a_0: over the first window; or "hold": given, everything stays as it is
    radius: float = 1.0  # no pole of an autoregression may lie farther from zero [-]
    noise_rate: float = tunable(0.05, 0.01, 0.3)  # rate at which the transition's noise follows [-]
    noise_gain: float = tunable(1.0, 0.25, 4.0)  # transition noise over what is left unexplained, variances [-]
    window: int = 64  # readings that the wavelets and a_0 look back
    smoothing: float = tunable(0.1, 0.02, 0.5)  # of the sensors' variances [-]
    constant: str = "donoho"  # that makes a median a sigma; or "printed"
    least_noise: float = 0.25  # no channel's variance falls below this share of the data sheet's [-]
    alpha: float = tunable(1.5, 1.0, 2.0)  # characteristic exponent of the Cauchy-Gaussian likelihood, 2 is Gaussian
    heavy: tuple[str, ...] = CHANNELS  # channels whose likelihood is Cauchy-Gaussian
    resample_below: float = 0.5  # effective sample size over N [-]

    def __post_init__(self) -> None:
        super().__post_init__()
        names = (("gain", GAINS), ("start", STARTS), ("constant", tuple(CONSTANTS)))
        for name, known in names:
            if getattr(self, name) not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, not {getattr(self, name)!r}")
        if self.size < 2 or self.window < 2 * self.order:
            sizes = f"{self.size} and {self.window}"
            raise ValueError(f"size must be at least 2 and window twice the order, not {sizes}")
        if self.window % 2:
            raise ValueError(f"window must be an even number of readings, not {self.window}")
        for name in ("coefficient", "noise_rate", "smoothing", "radius"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name} must lie in (0, 1], not {getattr(self, name)}")
        if not (0 <= self.noise_gain < math.inf and 0 <= self.least_noise < math.inf):
            raise ValueError(
                f"noise_gain and least_noise must not be negative, not {self.noise_gain} and {self.least_noise}"
            )
        contamination(self.alpha)
        check_range(0, 1, resample_below=self.resample_below)
        check_channels("heavy", self.heavy)

    @property
    def physics(self) -> bool:
        """Whether the autoregressions are of what a model of the car leaves over."""
        return False

    def init(self, nominal: Nominal, rng: np.random.Generator) -> Adapted:
        model, sheet = self.model.build(nominal), sheet_variances(nominal.sheet)
        mean, hold = model.prior_mean, np.zeros(self.order)
        hold[0] = 0.0 if self.physics else 1.0
        adaptation = AutoregressionTuning(
            rate=float(self.coefficient),
            noise_rate=float(self.noise_rate),
            printed=float(self.gain == "printed"),
            window=float(self.window) if self.start == "least_squares" else 0.0,
            radius=float(self.radius),
            start=hold,
        )
        fixed = ModelAdaptive(
            model=model,
            adaptation=adaptation,
            physics=self.physics,
            sheet=sheet,
            least_noise=float(self.least_noise),
            smoothing=float(self.smoothing),
            constant=CONSTANTS[self.constant],
            noise_gain=float(self.noise_gain),
            shares=cauchy_shares(contamination(self.alpha), self.heavy),
            resample_below=float(self.resample_below),
        )
        states = draw(mean, model.prior_cov, self.size, rng)
        first = np.zeros_like(mean) if self.physics else mean
        series = np.tile(np.zeros_like(states) if self.physics else states, (self.order, 1, 1))
        swarm = Swarm(
            states=states,
            series=series,
            weights=np.full(self.size, 1 / self.size),
            memory=model.memory,
            learnt=autoregressions(adaptation, first),
            noise=noise_level(sheet, self.window),
        )
        return Adapted(fixed, swarm, model.prior_cov, np.array([*mean[:3], 0.0, 0.0, self.size]))

    def update(self, state: Adapted, reading: Reading, rng: np.random.Generator) -> Adapted:
        return Adapted(state.fixed, *adaptive_step(state.fixed, state.swarm, reading.inputs, reading.y, rng))

    def estimate(self, state: Adapted) -> Estimate:
        vx, vy, yaw_rate, ax, ay, _ = state.output.tolist()
        return Estimate(vx, vy, yaw_rate, ax, ay, state.cov[:3, :3])

    def effective_size(self, state: Adapted) -> float:
        return float(state.output[5])

    def tell_friction(self, state: Adapted, friction: float) -> Adapted:
        model = state.fixed.model._replace(friction=float(friction))
        return state._replace(fixed=state.fixed._replace(model=model))


@dataclass(frozen=True)
class PhysicsAdaptiveParticleFilter(ModelAdaptiveParticleFilter):
    """``mapf`` with the car in the transition: the autoregressions are of what a model's prediction leaves over.

    Not in the paper of Qin et al. (2014): an autoregression alone cannot see the driver turn the wheel.
    """

    model: ModelTuning = PHYSICS_TUNING

    @property
    def physics(self) -> bool:
        return True
