"""Everything that has a name, on one page."""

from typing import Any

from vse_gym.registry import Registry

ESTIMATORS: Registry[Any] = Registry(
    "vse_gym.estimators",
    {
        "truth": "vse_gym.estimators.anchors:Truth",
        "truth_velocity": "vse_gym.estimators.anchors:TruthVelocity",
        "zero": "vse_gym.estimators.anchors:ZeroSideslip",
        "kinematic": "vse_gym.estimators.kinematic:KinematicObserver",
        "luenberger": "vse_gym.estimators.luenberger:LuenbergerObserver",
        "kf": "vse_gym.estimators.bicycle:LinearKalmanFilter",
        "switching": "vse_gym.estimators.switching:SwitchingEstimator",
        "fusion": "vse_gym.estimators.fusion:FusionEstimator",
        "ekf": "vse_gym.estimators.gaussian:ExtendedKalmanFilter",
        "ekf_told": "vse_gym.estimators.gaussian:ToldExtendedKalmanFilter",
        "ukf": "vse_gym.estimators.gaussian:UnscentedKalmanFilter",
        "ekf_double_track": "vse_gym.estimators.gaussian:DoubleTrackExtendedKalmanFilter",
        "ukf_double_track": "vse_gym.estimators.gaussian:DoubleTrackUnscentedKalmanFilter",
        "ckf": "vse_gym.estimators.gaussian:CubatureKalmanFilter",
        "sr_ukf": "vse_gym.estimators.gaussian:SquareRootUnscentedKalmanFilter",
        "ekf_cauchy_gaussian": "vse_gym.estimators.gaussian:CauchyGaussianKalmanFilter",
        "iae_ekf": "vse_gym.estimators.innovation_adaptive:InnovationAdaptiveKalmanFilter",
        "strong_tracking": "vse_gym.estimators.strong_tracking:StrongTrackingKalmanFilter",
        "imm": "vse_gym.estimators.multiple_model:InteractingMultipleModel",
        "ukf_friction": "vse_gym.estimators.friction:FrictionUnscentedKalmanFilter",
        "mhe": "vse_gym.estimators.moving_horizon:MovingHorizonEstimator",
        "ekf_3dof": "vse_gym.estimators.fuzzy_adaptive:ThreeDofExtendedKalmanFilter",
        "ekf_3dof_car": "vse_gym.estimators.fuzzy_adaptive:CarThreeDofExtendedKalmanFilter",
        "rls_faekf": "vse_gym.estimators.fuzzy_adaptive:FuzzyAdaptiveKalmanFilter",
        "rls_faekf_car": "vse_gym.estimators.fuzzy_adaptive:CarFuzzyAdaptiveKalmanFilter",
        "sr_ukf_rls": "vse_gym.estimators.stiffness_adaptive:StiffnessAdaptiveKalmanFilter",
        "enkf": "vse_gym.estimators.ensemble:EnsembleKalmanFilter",
        "pf": "vse_gym.estimators.particle:BootstrapParticleFilter",
        "pf_cauchy_gaussian": "vse_gym.estimators.particle:CauchyGaussianParticleFilter",
        "mapf": "vse_gym.estimators.model_adaptive:ModelAdaptiveParticleFilter",
        "mapf_physics": "vse_gym.estimators.model_adaptive:PhysicsAdaptiveParticleFilter",
        "ackf": "vse_gym.estimators.adaptive_cubature:AdaptiveCubatureKalmanFilter",
        "upf": "vse_gym.estimators.sigma_particle:UnscentedParticleFilter",
        "acpf": "vse_gym.estimators.sigma_particle:AdaptiveCubatureParticleFilter",
        "gru": "vse_gym.estimators.learned:RecurrentEstimator",
        "kalman_gru": "vse_gym.estimators.learned:CorrectedKalmanFilter",
    },
    base="vse_gym.estimators.base:Estimator",
)

CONTROLLERS: Registry[Any] = Registry(
    "vse_gym.controllers",
    {
        "none": "vse_gym.controllers.base:NoControl",
        "esc": "vse_gym.controllers.esc:StabilityControl",
        "sideslip_esc": "vse_gym.controllers.esc:SideslipStabilityControl",
        "lqr": "vse_gym.controllers.lqr:LinearQuadraticRegulator",
        "sliding_mode": "vse_gym.controllers.sliding_mode:SlidingModeControl",
        "phase_plane": "vse_gym.controllers.phase_plane:PhasePlaneControl",
        "mpc": "vse_gym.controllers.mpc:ModelPredictiveControl",
    },
    base="vse_gym.controllers.base:Controller",
)

MANOEUVRES: Registry[Any] = Registry(
    "vse_gym.manoeuvres",
    {
        "sine_with_dwell": "vse_gym.manoeuvres.sine_with_dwell:SineWithDwell",
        "slowly_increasing_steer": "vse_gym.manoeuvres.slowly_increasing_steer:SlowlyIncreasingSteer",
        "straight_driving": "vse_gym.manoeuvres.straight_driving:StraightDriving",
        "held_steer": "vse_gym.manoeuvres.held_steer:HeldSteer",
        "double_lane_change": "vse_gym.manoeuvres.double_lane_change:DoubleLaneChange",
        "triple_lane_change": "vse_gym.manoeuvres.triple_lane_change:TripleLaneChange",
        "obstacle_avoidance": "vse_gym.manoeuvres.obstacle_avoidance:ObstacleAvoidance",
        "slalom": "vse_gym.manoeuvres.slalom:Slalom",
        "split_friction_braking": "vse_gym.manoeuvres.split_friction_braking:SplitFrictionBraking",
        "friction_jump": "vse_gym.manoeuvres.friction_jump:FrictionJump",
        "brake_in_turn": "vse_gym.manoeuvres.brake_in_turn:BrakeInTurn",
        "step_steer": "vse_gym.manoeuvres.step_steer:StepSteer",
        "steady_circle": "vse_gym.manoeuvres.steady_circle:SteadyCircle",
        "sine_steer": "vse_gym.manoeuvres.sine_steer:SineSteer",
        "gentle_curve": "vse_gym.manoeuvres.gentle_curve:GentleCurve",
    },
    base="vse_gym.manoeuvres.base:Manoeuvre",
)
