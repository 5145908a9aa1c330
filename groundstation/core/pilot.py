"""Poses in, commands out: the estimator, the controller and the reference of one vehicle. Sans-IO."""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import msgspec

from groundstation.core.control import (
    OFF,
    Adaptive,
    CertificateMonitor,
    ControllerConfig,
    Descent,
    Gains,
    ask,
    ask_thrust,
    calm,
    clamp_command,
    level,
    make_controller,
    plan_bring_down,
    plan_model_descent,
    push,
    sine_error,
)
from groundstation.core.estimation import ModelEstimator
from groundstation.core.geometry import FLOATS, Quat, Vec3, euler_zyx, third_column
from groundstation.core.messages import (
    GAIN,
    Certificate,
    Decision,
    Estimate,
    FlightEvent,
    IdleRecord,
    Pose,
    PoseRecord,
    SwitchRecord,
    Tick,
    TrajectoryRecord,
    ignore,
)
from groundstation.core.safety import STILL_SUSPECTS, Obedience, PoseEvidence, ResponseLatency
from groundstation.core.trajectory import Reference, Trajectory
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate, schedule
from links.core import Command, Segment

WIND_MEMORY_S = 1.0
"""Over which the disturbance is averaged for the bring-down [s]: the gust of this moment will be over by then."""
ASKS = 0.3
"""From this share of what convicts on [-] the poses are asked by a small turn, where it is the attitude that speaks
against them, and a descent lifts less against what may be a lie."""
BEGINS_S = 1.0
"""For so long off the floor nothing is asked [s]: it begins without a step."""
RESTS_M_S, RESTS_S = 0.05, 1.0
"""So are they where the reference was no faster [m/s] for so long [s]: in a hold they have nothing to answer to."""
CALM_S = 5.0
"""So long after the poses were suspect our controller flies calmly [s], the figure, too."""
SPARSE_S, SPARSE_MEAN_S = 0.07, 1.0
"""So it does where poses are as far apart as this [s], on average of so long [s]: between them errors grow unseen."""
DIVERGED_M = 0.05
"""So far from where the model had the vehicle a pose may be false, where a descent begins blind [m]."""
FALLS, UPRIGHT = 0.35, 0.5
"""Off the figure errors take away at most such a share of the weight from the thrust that the reference asks for [-],
while the cosine of the vehicle's lean is above the second: heights that are mirrored or leap must not drop it."""
LEANS, LEANS_GAIN = math.sin(math.radians(40.0)), 6.0
"""Off the figure errors make it lean at most by that sine away from the push that the mean wind and the reference ask
for [-]; it turns towards that no faster than by the second times what is left [1/s]."""
CLIMBS, CLIMBS_S, CLIMBS_MORE = 1.2, 1.0, 0.5
"""So much of what hovered as it left the floor is pushed at most at first [-], and from so long after [s] on by so much
more each second [1/s], ..."""
CLIMBED_M = 0.25
"""... until the poses have shown that it rises by so much [m]: what they leave out is pushed against gently."""
CUSHIONED = 0.95
"""As a share of the weight as told: with less it is the floor's cushion that carries, and soon no more [-]."""
UNHEARD_SHARE, UNHEARD_M_S2, UNHEARD_GAIN = 0.95, 1.5, 0.15
"""Where nothing shows that commands arrive, thrust is at most this share of what hovers [-], of a disturbance so much
is believed in that [m/s²], and rates are this share of the law's [-]: a loop of 4/s that is 1.5 s late is stable by it.
"""
UNHEARD_SINK_M_S = 0.4
"""What sinks faster than this [m/s] is not let fall faster still: then all that hovers is told, and never more."""
LET_GO_S = 0.5
"""Where commands come too late, the last one goes on for so long [s]: the autopilot is asked to land meanwhile."""
HOLD_STEP_S = 0.08
"""Longest single step of the model while a command is held to its deadline [s]."""

TRUST_S = 0.4
"""So long before suspicion began is the estimate believed again [s]: what was seen just then may be false already."""
LEARNT_S = 1.2
"""So much longer before is believed what was learnt of wind and thrust [s]: a slow lie is learnt as one of these."""
REMEMBER_S = 5.0
"""How far back estimates and commands are kept for that [s]."""
GUST_M_S2 = 2.0
"""A disturbance that is found to change by so much against its mean [m/s²] moves a vehicle, or is none."""
UPSET_M_S2 = 4.0
"""A change by so much is no gust of any wind to fly in [m/s²]: a storm's reach 2."""
PUSHED_S = 0.2
"""A position that stands against that for so long [s] is not the vehicle's, or the vehicle is held."""
NEAR_FLOOR_M = 0.12
"""So near the floor it holds a vehicle that is meant to come down, too [m]: obedience is not asked there."""

NOISE_POSES = 50
"""After so many poses the watch hears of their noise and interval again."""


class Trusted(NamedTuple):
    """The vehicle at one pose, from when nothing was suspicious."""

    time_s: float
    motion: Motion
    disturbance: Vec3
    """The mean of the last second [m/s², NED]."""
    effectiveness: float


class Pilot:
    """One vehicle's pose → command pipeline. The caller owns time, wires and the mission."""

    def __init__(
        self,
        vehicle: Vehicle,
        config: ControllerConfig,
        coast_s: float,
        floor_z_m: float,
        tell: Callable[[FlightEvent | Tick], None] = ignore,
        clock: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """Take the vehicle as told, the controller's config, and how long commands may rest on one pose [s].

        ``floor_z_m`` is where its pose is when it stands on the floor [m, NED]; ``tell`` hears all that the pilot is
        given and makes, by the event loop's ``clock`` [s].

        Raises:
            ConfigError: a controller of the user's own can't be loaded.
        """
        self._vehicle = vehicle
        self._tell, self._clock = tell, clock
        self._coast = coast_s
        self._floor = floor_z_m
        self._gravity = config.gravity
        self._wind: Vec3 | None = None
        self._estimator = ModelEstimator(vehicle, config)
        self._controller = make_controller(config, vehicle)
        self._gains = config
        # What the mission wants, and what is flown.
        self._eased = self._asks = self._calm = False
        self._rests_s = 0.0
        self._suspected_s = -math.inf
        # An observer that does not find the disturbance by itself is driven by b̂.
        driven = config.composite != "provable"
        self._driver = self._controller if driven and isinstance(self._controller, Adaptive) else None
        self._watch = CertificateMonitor(vehicle, config)
        self._obedience = Obedience(vehicle.mass_kg, config.gravity)
        self._unheard = self._touches = False
        self._lifted = self._climbed = False
        self._lifted_s = self._left_s = -math.inf
        self._hover_n, self._left_down = math.inf, 0.0
        self._meant_m = -math.inf
        self.response = ResponseLatency()
        """How much later than told the vehicle is seen to turn."""
        self.upset = False
        """Whether something moves the vehicle as no wind to fly in does."""
        self._pushed_since_s: float | None = None
        self._trusted: deque[Trusted] = deque()
        self._drives: deque[tuple[float, ActuatorCommand]] = deque()
        self._poses, self._counted_s, self._apart_s = 0, 0.0, 0.0
        self._last: float | None = None
        self._pose: Pose | None = None
        self._trajectory: Trajectory | None = None
        self._start = 0.0
        self._released = False
        self._descent: Descent | None = None
        self._sink: Vec3 = (0.0, 0.0, 0.0)

    @property
    def newest_pose(self) -> Pose | None:
        """The newest pose taken, or None."""
        return self._pose

    @property
    def certificate(self) -> Certificate | None:
        """V against its bound so far, for screens."""
        return self._watch.reading()

    def pose(self, pose: Pose) -> None:
        """Take one pose; one that is not newer than the last is ignored."""
        self._tell(PoseRecord(pose))
        if self._pose is None or pose.time_s > self._pose.time_s:
            before = self._estimator.motion
            if self._pose is not None:
                apart_s = pose.time_s - self._pose.time_s
                self._apart_s += apart_s / (apart_s + SPARSE_MEAN_S) * (apart_s - self._apart_s)
            self._estimator.update(pose)
            if not self._released:
                self._obedience.rest(pose)
            elif before is not None:
                self._obeys(pose, before)
            self._pose = pose
            self._poses += 1
            if self._poses == 1:
                self._counted_s = pose.time_s
            elif self._poses % NOISE_POSES == 1:
                self._watch.noise(self._estimator.noise_m, (pose.time_s - self._counted_s) / NOISE_POSES)
                self._counted_s = pose.time_s

    def follow(self, trajectory: Trajectory, start_s: float) -> None:
        """From now on the reference is ``trajectory``, begun at ``start_s`` on the event loop's clock [s]."""
        self._tell(TrajectoryRecord(start_s))
        if not self._released:
            self._estimator.release()
            self._released = True
            self._trust_from_here((0.0, 0.0, 0.0))
            self._obedience.restart()
        self._trajectory = trajectory
        self._start = start_s
        self._watch.restart()

    def gain(self, name: str, value: float) -> None:
        """From now on one gain of our own controller is ``value``; the caller moves it in small steps."""
        self._switch(f"{GAIN}{name}", value)
        if isinstance(self._gains, Gains):
            self._regain(msgspec.structs.replace(self._gains, **{name: value}), calmly=self._calm)

    def ease(self, calmly: bool, *, asks: bool) -> None:
        """From now on our own controller flies ``calmly``: no figure, but up, down or in place.

        ``asks`` where the poses are to be asked all the time, as the law gives them nothing to answer.
        """
        self._switch("ease", float(calmly), float(asks))
        self._eased, self._asks = calmly, asks

    def _switch(self, what: str, *values: float) -> None:
        """Tell that it is to fly otherwise."""
        self._tell(SwitchRecord(self._clock(), what, values))

    def _calm_down(self, time_s: float) -> bool:
        """Have our own controller fly calmly where it is eased or the poses were suspect of late; whether they were."""
        if self.suspicious:
            self._suspected_s = time_s
        suspect = time_s - self._suspected_s < CALM_S
        calmly = self._eased or suspect or self._apart_s > SPARSE_S
        if calmly != self._calm and isinstance(self._gains, Gains):
            self._regain(self._gains, calmly=calmly)
        return suspect

    def _regain(self, gains: Gains, *, calmly: bool) -> None:
        assert isinstance(self._controller, Adaptive), "it has these gains"
        self._gains, self._calm = gains, calmly
        now = calm(gains) if calmly else gains
        self._controller.regain(now)
        self._watch.regain(now)

    def touch(self, touches: bool) -> None:
        """Whether something carries it already, or may: then it is kept level, whatever it is to do sideways."""
        if touches != self._touches:
            self._switch("touch", float(touches))
            self._touches = touches

    def listen(self, unheard: bool) -> None:
        """Whether nothing shows that commands arrive: then nothing is learnt, and they are gentle in case some do."""
        if unheard == self._unheard:
            return
        self._switch("listen", float(unheard))
        self._unheard = unheard
        if unheard:
            self._hold()
        else:
            self._estimator.resume()

    def doubt(self) -> None:
        """Poses have come further from the last ones than the vehicle can have flown: some of them are false."""
        if self._lifted and self._descent is None and not self._estimator.holds:
            self._switch("doubt")
            self._hold(at_once=True)

    def _hold(self, *, at_once: bool = False) -> None:
        """Learn nothing; wind and thrust are those of before."""
        trusted = self._before()
        self._estimator.hold(trusted.disturbance, trusted.effectiveness, at_once=at_once)

    def stand(self) -> None:
        """The vehicle stands on the floor: its push is not to be learnt."""
        self._switch("stand")
        self._estimator.frozen = True

    def lift(self, time_s: float, hover_share: float, climb_m_s: float) -> Reference:
        """The vehicle has just left the floor; returns the motion in which it will be when a command acts.

        ``hover_share`` is the thrust that seems to hover as a share of the weight, ``climb_m_s`` how fast it climbs.
        """
        self._switch("lift", time_s, hover_share, climb_m_s)
        disturbance = self._estimator.lift_off(climb_m_s, hover_share)
        if isinstance(self._controller, Adaptive):
            self._controller.begin(disturbance)
        self._released = self._lifted = True
        hovers = max(hover_share, CUSHIONED)
        north, east, _ = disturbance  # against which it leans, and so needs more thrust to hover
        self._left_s, self._hover_n = time_s, hovers * self._vehicle.mass_kg * math.hypot(self._gravity, north, east)
        self._trust_from_here(disturbance)
        self._obedience.lift_off(hovers, climb_m_s)
        motion = self._estimator.predict(time_s + self._vehicle.acting_delay_s).motion
        self._left_down = motion.position[2]
        return Reference(motion.position, motion.velocity, yaw_rad=euler_zyx(motion.attitude)[2])

    @property
    def diverged_m(self) -> float:
        """How far the newest pose was from where the model had the vehicle [m]."""
        return self._estimator.diverged_m

    @property
    def noise_m(self) -> float:
        """Position noise of the poses as measured, 1σ per axis [m]."""
        return self._estimator.noise_m

    @property
    def evidence(self) -> PoseEvidence:
        """What speaks against the poses, as shares of what convicts (control/obedience.py)."""
        found, since = self._obedience.evidence, self._pushed_since_s
        if since is None:
            return found
        lasts = self._newest_s - since >= PUSHED_S - 1e-6
        return found._replace(still=max(found.still, 1.0 if lasts else STILL_SUSPECTS))

    @property
    def astray_m(self) -> float:
        """How far an estimate that wanders may have gone since it left the floor [m]."""
        return self._obedience.astray_m(self._newest_s - self._lifted_s)

    @property
    def monitor(self) -> Obedience:
        """The monitor itself, for what it counts."""
        return self._obedience

    @property
    def suspicious(self) -> bool:
        """Whether nothing is learnt from the poses at present."""
        return self._estimator.holds

    @property
    def blind(self) -> bool:
        """Whether a failsafe descent does not believe the estimate of the speed."""
        return self._descent is not None and self._descent.blind

    def descend(self, sink_m_s: float, *, blind: bool = False, rest_s: float = 0.0) -> None:
        """From now on only level out and sink; ``blind`` where the estimate of the speed is not to be believed.

        ``rest_s`` is how much longer commands may rest on one pose then [s].
        """
        self._switch("descend", sink_m_s, float(blind), rest_s)
        if self._descent is None:
            self._coast += rest_s
        if self._descent is None or (blind and not self._descent.blind):
            self._estimator.frozen = True  # what thrust seems to give is not learnt from poses that may be at fault
            learnt = self._learnt()
            wind = self._wind or learnt.disturbance
            doubted = max(self.evidence) >= ASKS
            if blind or doubted:
                wind = learnt.disturbance
            if blind and (doubted or self.diverged_m > DIVERGED_M):
                # What the poses showed of late may be false.
                motion = self._reckon(self._before(), self._newest_s)
                self._estimator.believe(motion, wind, learnt.effectiveness)
            sinks = self._estimator.predict(max(self._last or 0.0, self._newest_s)).motion.velocity[2]
            rises = -sinks if sinks < 0.0 else -max(sinks - sink_m_s, 0.0)
            effectiveness = learnt.effectiveness
            if self._newest_s - self._lifted_s < LEARNT_S + TRUST_S:
                # Poses that are late, or lie, leave the floor late, which looks like thrust weaker than told.
                effectiveness = max(effectiveness, 1.0)
            self._descent = Descent(self._vehicle, self._gravity, wind, effectiveness, rises)
        self._descent.blind = blind
        self._sink = (0.0, 0.0, sink_m_s)
        self._watch.restart()

    def idle(self, time_s: float, thrust_n: float) -> Command:
        """A command that holds the rates at zero and the thrust at ``thrust_n``, resting on the newest pose."""
        drive = ActuatorCommand(thrust_n, (0.0, 0.0, 0.0))
        self._send(time_s, drive)
        self._last = None
        command = self._command(drive, OFF if thrust_n > 0.0 else ())
        self._tell(IdleRecord(time_s, thrust_n, command))
        return command

    def tick(self, time_s: float) -> Tick:
        """The command for a frame that leaves at ``time_s``. Needs a pose and a trajectory."""
        pose, descent = self._pose, self._descent
        assert pose is not None and self._trajectory is not None, "tick() needs a pose and a trajectory"
        acting = time_s + self._vehicle.acting_delay_s
        estimate = self._estimator.predict(acting)
        flight_time = acting - self._start
        reference = self._trajectory.at(flight_time)
        suspect = self._calm_down(time_s)
        self._meant_m = -math.inf if descent is not None else self._floor - reference.position_ned[2]
        if descent is not None:
            descent.doubted = suspect or max(self.evidence) >= ASKS
            reference = Reference(estimate.motion.position, self._sink)
        elif self.suspicious:  # no error is believed: what is left is the trim of before
            motion = estimate.motion
            reference = Reference(motion.position, motion.velocity, yaw_rad=reference.yaw_rad)
        interval = 0.0 if self._last is None or self._unheard else time_s - self._last
        self._last = time_s
        law = self._decide if descent is None else descent.decide
        decision = law(estimate, reference, interval)
        if descent is None and (self._eased or self._apart_s > SPARSE_S):
            decision = self._bear(decision, estimate, reference)
        if descent is None:
            decision = self._climb_gently(time_s, decision)
            if self._touches:
                decision = self._level(decision, estimate)
        if self._unheard:
            decision = self._soften(decision, estimate)
        self._rests_s = self._rests_s + interval if math.hypot(*reference.velocity_ned) < RESTS_M_S else 0.0
        rests = self._asks or (self._lifted and self._rests_s > RESTS_S)
        begun = time_s - self._lifted_s > BEGINS_S and self._hover_n == math.inf
        self._obedience.asks = asks = descent is None and rests and begun
        if asks or (descent is None and (self.suspicious or self.evidence.attitude >= ASKS)):
            # A body that obeys answers, and is suspect no longer.
            (roll, pitch, yaw), (more, also) = decision.drive.rates, ask(time_s)
            thrust = decision.drive.thrust * (ask_thrust(time_s) if asks else 1.0)
            drive, _ = clamp_command(self._vehicle, thrust, (roll + more, pitch + also, yaw))
            decision = decision._replace(drive=drive)
        self._send(time_s, decision.drive)
        if self._driver is not None:
            self._estimator.follow(self._driver.b_hat)
        wind = self._mean_wind(estimate.disturbance, interval)
        if descent is not None and descent.blind:
            wind = descent.wind
        parts = self._bring_down(estimate, decision.drive, pose.time_s + self._coast - time_s, wind)
        seen = self._watch.look(time_s, estimate.motion, decision)
        command = self._command(decision.drive, parts)
        tick = Tick(time_s, flight_time, pose, estimate, reference, decision, command, seen)
        self._tell(tick)
        return tick

    def _decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command of the law."""
        law, sooner_s = self._controller, self._vehicle.sooner_s
        if sooner_s == 0.0 or not isinstance(law, Adaptive):
            return law.decide(estimate, reference, interval_s)
        sooner = self._estimator.predict(estimate.time_s - sooner_s)
        return law.decide_apart(sooner, estimate, reference, interval_s)

    def _bear(self, decision: Decision, estimate: Estimate, reference: Reference) -> Decision:
        """``decision`` with thrust enough that an error alone does not make the vehicle fall, while it is upright."""
        (x, y, z), (thrust, rates), g = reference.acceleration_ned, decision.drive, self._gravity
        vehicle, effectiveness = self._vehicle, estimate.effectiveness
        mass = vehicle.mass_kg / (effectiveness if effectiveness > 1.0 else 1.0)
        least = min(mass * (math.sqrt(x * x + y * y + (z - g) ** 2) - FALLS * g), vehicle.thrust_max_n)
        attitude = estimate.motion.attitude
        if third_column(attitude)[2] >= UPRIGHT:
            thrust = max(thrust, least)
        rates = self._keep_upright(attitude, rates, push((x, y, z), self._wind or (0.0, 0.0, 0.0), g)[0])
        drive, _ = clamp_command(vehicle, thrust, rates)
        return decision._replace(drive=drive)

    def _keep_upright(self, attitude: Quat, rates: Vec3, along: Vec3) -> Vec3:
        """``rates`` that leave the body's z axis near the push ``along`` [m/s², NED], or bring it back: a barrier."""
        roll, pitch = sine_error(attitude, along)
        sine = math.hypot(roll, pitch)
        if sine < 1e-6:
            return rates
        x, y, z = third_column(attitude)
        beyond = x * along[0] + y * along[1] + z * along[2] < 0.0  # 90°: the sine falls again
        back = LEANS_GAIN * ((1.0 if beyond else sine) - LEANS)
        more = back - (rates[0] * roll + rates[1] * pitch) / sine
        if more <= 0.0:
            return rates
        wanted = rates[0] + more * roll / sine, rates[1] + more * pitch / sine, rates[2]
        (_, (p, q, r)), cut = clamp_command(self._vehicle, 0.0, wanted)
        less = back - (p * roll + q * pitch) / sine
        if not cut or less <= 0.0:
            return p, q, r
        # At a limit: as far as it must towards the rates that bring it back as fast as can be.
        a, b, _ = (math.radians(limit) for limit in self._vehicle.rate_limits_deg_s)
        p_most, q_most = math.copysign(a, roll), math.copysign(b, pitch)
        share = min(less * sine / ((p_most - p) * roll + (q_most - q) * pitch), 1.0)
        return p + share * (p_most - p), q + share * (q_most - q), r

    def _climb_gently(self, time_s: float, decision: Decision) -> Decision:
        """``decision`` with no more thrust than a vehicle needs that has just left the floor."""
        since_s, (thrust, rates) = time_s - self._left_s, decision.drive
        if self._pose is not None and self._left_down - self._pose.position_ned[2] > CLIMBED_M:
            self._hover_n = math.inf
        most = self._hover_n * (CLIMBS + CLIMBS_MORE * max(since_s - CLIMBS_S, 0.0))
        if thrust <= most:
            return decision
        return decision._replace(drive=ActuatorCommand(most, rates))

    def _level(self, decision: Decision, estimate: Estimate) -> Decision:
        """``decision`` with rates that only level it into the wind: sideways control would tip what stands."""
        rates = level(estimate.motion.attitude, self._wind or (0.0, 0.0, 0.0), self._gravity)
        return decision._replace(drive=clamp_command(self._vehicle, decision.drive.thrust, rates)[0])

    def let_go(self, time_s: float, hold_s: float) -> Command:
        """The last command, where those that leave come too late: gently on, until the autopilot acts by itself.

        Times are as in :meth:`surrender`. A bring-down that comes late would brake what does not fall.
        """
        self._switch("let_go", hold_s)
        pose = self._pose
        assert pose is not None, "only what has flown by poses ceases to"
        thrust = UNHEARD_SHARE * self._hovers_n(self._estimator.predict(time_s + self._vehicle.acting_delay_s))
        still = (0.0, 0.0, 0.0)
        parts = (Segment(LET_GO_S, thrust, still),)
        command = Command(thrust, still, pose.id, pose.time_s, time_s + hold_s, parts)
        self._tell(IdleRecord(time_s, thrust, command))
        return command

    def _hovers_n(self, estimate: Estimate) -> float:
        """The thrust that hovers, as far as is believed while nothing shows that commands arrive [N]."""
        down = max(-UNHEARD_M_S2, min(estimate.disturbance[2], UNHEARD_M_S2))
        return self._vehicle.mass_kg / estimate.effectiveness * (self._gravity + down)

    def _soften(self, decision: Decision, estimate: Estimate) -> Decision:
        """``decision`` as it does no harm where it comes too late, or to a vehicle that has not heard those before."""
        thrust, (roll, pitch, yaw) = decision.drive
        share = UNHEARD_SHARE if estimate.motion.velocity[2] < UNHEARD_SINK_M_S else 1.0
        k, most = UNHEARD_GAIN, share * self._hovers_n(estimate)
        return decision._replace(drive=ActuatorCommand(min(thrust, most), (k * roll, k * pitch, k * yaw)))

    def surrender(self, time_s: float, hold_s: float) -> Command:
        """The last command, where the poses are not believed any more: down on the model, from what it was before.

        It leaves at ``time_s`` and holds for ``hold_s`` [s], so that it reaches the link's next frame; the rest is its
        bring-down.
        """
        self._switch("surrender", hold_s)
        pose, vehicle = self._pose, self._vehicle
        assert pose is not None, "only what has flown by poses ceases to"
        acting = time_s + vehicle.acting_delay_s
        before = self._before()
        motion = self._reckon(before, acting)
        mass = vehicle.mass_kg / before.effectiveness
        first, *rest = plan_model_descent(
            motion, vehicle, mass_kg=mass, gravity=self._gravity, disturbance=before.disturbance,
            height_m=self._floor - motion.position[2],
        )  # fmt: skip
        command = Command(first.thrust_n, first.rates_rad_s, pose.id, pose.time_s, time_s + hold_s, tuple(rest))
        self._tell(IdleRecord(time_s, command.thrust_n, command))
        return command

    def _trust_from_here(self, disturbance: Vec3) -> None:
        """It begins to fly: the estimate is believed as it is now."""
        motion = self._estimator.motion
        assert motion is not None, "nothing flies without a pose"
        self._lifted_s = self._newest_s
        self._trusted.clear()
        self._trusted.append(Trusted(self._newest_s, motion, disturbance, self._estimator.effectiveness))

    def _obeys(self, pose: Pose, before: Motion) -> None:
        """Hold one more pose against the commands; learn nothing while it is suspect."""
        estimator, given = self._estimator, self._estimator.given
        motion = estimator.motion
        if given is None or motion is None:
            return
        shown_m, near_m = abs(self._floor - pose.position_ned[2]), NEAR_FLOOR_M + self.astray_m
        high = shown_m > near_m or self._meant_m > 2.0 * near_m
        self._climbed = self._climbed or high
        wind = self._wind or (0.0, 0.0, 0.0)
        gust = math.dist(estimator.disturbance, wind)
        self.upset = gust > UPSET_M_S2
        node = self._obedience.pose(
            pose, before, given, pose.time_s - self._newest_s, estimator.noise_m,
            counts=high or not self._climbed, upset=self.upset, off_m=estimator.diverged_m,
        )  # fmt: skip
        if high and self._descent is None and not estimator.holds:
            self.response.pose(pose.attitude, self._obedience.told_turn, pose.time_s - self._newest_s)
        if not node:
            return
        if not self._obedience.stands(pose.time_s) or (gust <= GUST_M_S2 and not estimator.holds):
            self._pushed_since_s = None
        elif self._pushed_since_s is None:
            self._pushed_since_s = pose.time_s
        if self.evidence.suspicious and self._lifted:
            if not estimator.holds:
                self._hold()
        elif not self._unheard:
            estimator.resume()
            self._trusted.append(Trusted(pose.time_s, motion, wind, estimator.effectiveness))
            while self._trusted[0].time_s < pose.time_s - REMEMBER_S:
                self._trusted.popleft()

    def _before(self) -> Trusted:
        """The newest estimate of well before suspicion began, or the first."""
        late_s, seen = self._obedience.late_s, self._estimator.motion
        newest = self._trusted_at(self._obedience.calm_s - TRUST_S)
        found = self.evidence
        if max(found.still, found.push) < max(found) and late_s == 0.0:
            return newest
        older = self._learnt()
        if late_s > 0.0 and seen is not None:
            # Poses that are only late are true of then. Of what the vehicle did since, the model knows about half.
            (x, y, z), (u, v, w), half_s = seen.position, seen.velocity, 0.5 * late_s
            seen = seen._replace(position=(x + half_s * u, y + half_s * v, z + half_s * w))
            newest = newest._replace(time_s=self._newest_s - half_s, motion=seen)
        return newest._replace(disturbance=older.disturbance, effectiveness=older.effectiveness)

    def _learnt(self) -> Trusted:
        """The estimate from which wind and thrust are believed, where a slow lie may have been learnt as these.

        Just off the floor it is the first or the newest one, whichever is nearer to what was told of the thrust: the
        floor's cushion falsifies the one, and what began meanwhile the other.
        """
        first, until = self._trusted[0], self._obedience.calm_s - TRUST_S
        if first.time_s <= until - LEARNT_S:
            return self._trusted_at(until - LEARNT_S)
        return min(first, self._trusted_at(until), key=lambda one: abs(one.effectiveness - 1.0))

    def _trusted_at(self, time_s: float) -> Trusted:
        """The newest estimate that is no younger than ``time_s`` [s], or the first."""
        return next((one for one in reversed(self._trusted) if one.time_s <= time_s), self._trusted[0])

    def _reckon(self, before: Trusted, until_s: float) -> Motion:
        """Where the commands sent have taken the vehicle since ``before``, by ``until_s`` [s]."""
        motion, now, mass = before.motion, before.time_s, self._vehicle.mass_kg / before.effectiveness
        drives = list(self._drives)
        for i, (begins, drive) in enumerate(drives):
            ends = min(drives[i + 1][0] if i + 1 < len(drives) else until_s, until_s)
            if ends > max(begins, now):
                motion = self._roll(motion, drive, ends - now, mass, before.disturbance)
            now = max(now, ends)
        return motion

    def _roll(
        self, motion: Motion, drive: ActuatorCommand, duration_s: float, mass_kg: float, disturbance: Vec3
    ) -> Motion:
        """``motion`` after ``duration_s`` [s] of one ``drive``, in steps that the model can take."""
        vehicle = self._vehicle
        steps = int(duration_s / HOLD_STEP_S) + 1
        for _ in range(steps):
            motion = integrate(
                FLOATS,
                motion,
                drive,
                duration_s / steps,
                mass=mass_kg,
                gravity=self._gravity,
                disturbance=disturbance,
                thrust_lag=vehicle.thrust_lag_s,
                rate_lag=vehicle.rate_lag_s,
                drag=vehicle.drag_per_s,
            )
        return motion

    def _send(self, time_s: float, drive: ActuatorCommand) -> None:
        """A command leaves at ``time_s`` [s]."""
        seen_s, drives = time_s + self._vehicle.command_delay_s, self._drives
        self._estimator.add_command(seen_s, drive)
        schedule(drives, self._vehicle, seen_s, drive)
        while drives[0][0] < seen_s - REMEMBER_S:
            drives.popleft()

    @property
    def _newest_s(self) -> float:
        return -math.inf if self._pose is None else self._pose.time_s

    def _command(self, drive: ActuatorCommand, parts: tuple[Segment, ...]) -> Command:
        pose = self._pose
        assert pose is not None, "a command needs a pose"
        return Command(drive.thrust, drive.rates, pose.id, pose.time_s, pose.time_s + self._coast, parts)

    def _mean_wind(self, now: Vec3, interval_s: float) -> Vec3:
        """The disturbance [m/s², NED] without its gusts."""
        mean = self._wind
        if mean is not None:
            k = interval_s / (interval_s + WIND_MEMORY_S)
            (a, b, c), (x, y, z) = mean, now
            now = (a + k * (x - a), b + k * (y - b), c + k * (z - c))
        self._wind = now
        return now

    def _bring_down(
        self, now: Estimate, drive: ActuatorCommand, held_s: float, disturbance: Vec3
    ) -> tuple[Segment, ...]:
        """What follows ``drive`` after the state ``now``, where it is held for ``held_s`` [s] and no other comes."""
        if held_s <= 0.0:
            return ()
        vehicle, motion = self._vehicle, now.motion
        mass = vehicle.mass_kg / now.effectiveness
        motion = self._roll(motion, drive, held_s, mass, disturbance)
        return plan_bring_down(
            motion,
            vehicle,
            mass_kg=mass,
            gravity=self._gravity,
            disturbance=disturbance,
            height_m=self._floor - motion.position[2],
        )
