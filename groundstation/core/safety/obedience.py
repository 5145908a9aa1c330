"""Obedience monitor: do the poses show what the commands must have done? Sans-IO.

A tracker can lie in ways that no single pose betrays: a picture that stands, another body's name, axes that are
mirrored, poses that are older than they say. What it cannot do is to answer our commands. So what the commands must
have made of the vehicle, c, is held against what the poses show, y, over nodes a tenth of a second apart:

- **Attitude.** c is the integral of the modelled body rates, y the turn from node to node, roll and pitch. Wind turns
  a vehicle hardly at all, so this is the sharp witness: even in a calm hold the law answers the noise of the poses.
- **Position.** c is the second integral of the modelled thrust along the attitude as seen, y the position; both go
  through one fading-memory filter of second order (Morrison 1969), which takes out constant acceleration. What is left
  is what moved within some tenths of a second. Wind moves the picture first and the law follows: then y is a part
  of c, or has its own way. A mirrored or turned picture answers with the command's own image, exactly.

The evidence is a log likelihood ratio between "it obeys" (y = c and noise) and its rival, summed with fading memory and
never below zero (Page's CUSUM, Biometrika 41, 1954):

- attitude: the rivals are a picture that does not answer, y = noise, and one whose axes are a quarter turn off; half
  an answer counts for neither. A rate lag or a gain that is told wrong by half leaves y on the side of c.
- heading: the turn about the vertical that no command asks for, averaged; a trim of some degrees a second is none.
  Rotors turn a vehicle about the vertical slowly, by their drag alone: an answer may be late by some tenths of a
  second.
- axes: the rival is the best of the seven other maps of the two horizontal axes onto themselves (mirrored, swapped,
  turned by quarter turns), and for the vertical one its mirror image; it must also beat a picture that stands.
- stillness: |y| is a twentieth of |c|, where wind that the law cancels, one delay late, leaves three tenths; or the
  position was stopped dead. This alone is a suspicion: a tether that holds the vehicle looks the same.

How an autopilot's own estimate wanders is measured while the vehicle stands, and added to the noise of positions.

The scale of the noise is measured by what the best rival leaves, and a node that none explains counts little: a hand,
a push or a reset speaks for neither. docs/explanation/guards.md has the curve of detection time against false alarms.

*Latency* of the response needs nobody but the poses: ω is what the model makes of the commands, by the lags and delays
that were told, and gravity lies where these rates have taken it. What the poses show comes δ later: gravity then lies
elsewhere in the body's axes by -δ ġ, where ġ = -ω × g; δ is what explains most of the difference, by least squares over
the last seconds. What differs slowly (a body mounted askew, an estimate that leans) is taken out of both sides first; a
heading takes no part. δ is the latency of the poses and the lag and delay of the rates in one: these are not told
apart, but what a loop has to bear is their sum.

What each rival would show, and how likely it is, stands in :mod:`groundstation.core.safety.rivals`.
"""

import math
from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

from groundstation.core.geometry import Quat, Vec3, third_row
from groundstation.core.messages import Pose
from groundstation.core.safety.rivals import (
    CLIMB_BEGINS,
    LEAPS_AS,
    NOISES,
    SETTLES,
    STAYS_S,
    WIND_M,
    Images,
    PositionAnswer,
    Rivals,
)
from groundstation.core.vehicle import ActuatorResponse, Motion

NODE_S, HALF_NODE_S = 0.1, 0.05 - 1e-6
"""Time between two nodes, and from one to the next between them [s]."""
GAP_S = 0.26
"""Poses further apart than this begin anew [s]: between them the model has gone astray."""
HOLE_S, UNHEARD_S, UNHEARD = 0.07, 0.3, 0.5
"""After a time so long without a pose [s] positions are not looked at for some nodes. The vehicle may have missed
commands then, too: for so long [s] what speaks against it by its attitude counts by so much [-]."""
HOLES_S = 1.0
"""Where one follows another sooner than that [s], the position is looked at all the same."""
FADE_S = 4.0
"""Evidence fades with this time constant [s]."""
NOISE_RISES = 0.5
"""The noise of the positions is believed to rise by such a share a second at most [1/s]: what leaps is none."""
LEARN_S = 4.0
"""So does what is known of the noise [s]."""
CALM = 2.0
"""Noise is learnt while the evidence is below this."""
FIRST, CAP = 5.0, 8.0
"""Most that one node may say of the attitude, the first and any other: no single outlier convicts."""
CONVICTS, IMAGE_CONVICTS, EARLY_CONVICTS, UPSET_CONVICTS, EARLY = 14.0, 9.0, 7.0, 4.0, 30
"""Evidence that convicts: e^14, a million to one, for each of the windows looked at; of an image, which must explain
better than both a vehicle that obeys and a picture that stands, e^9, and e^7 in so many windows after lift-off: axes
that are set up wrongly are so from the first. Across, and where the vehicle is upset as no gust does it, e^4: an
image drives it away ever faster, and little time is left."""
UPSET_SUSPECTS = 1.0
"""The same, from which on an image across is suspect where the vehicle is upset."""
CALM_SHARE = CALM / CONVICTS
SUSPECTS, HEADING_SUSPECTS, STILL_SUSPECTS, IMAGE_SUSPECTS, PUSH_SUSPECTS = 0.85, 0.5, 0.65, 0.7, 0.88
"""Share of it that is a suspicion: by the attitude, as two nodes whose commands got lost on their way come to 80 %; by
the heading; by a position that stands, or moves as an image."""
STILL_CAP = 2.0
"""Most that one node may say for a position that stands: a ramp of wind that the law follows lasts some nodes, too."""
STOPPED = 0.7
"""What a position that has just left its way counts as, until it moves again [-]."""
LOOKS, HALVES = 1.0, 12
"""From this evidence for an image on [-] it is looked for half-way between the nodes, too; the filter's memory is done
after so many."""
SLIP = 0.15
"""Share of the change of a command from node to node that may come a node earlier or later [-]."""
UNEXPLAINED = 8.0
"""A node that neither rival explains counts by so much less than its square [-]."""
ANSWER = 0.8
"""An answer of half this share of the command speaks for neither [-]: attitude."""
TURN_NOISE_RAD, TURN_FLOOR_RAD2 = 0.004, 0.0025 * 0.0025
"""Noise of a turn between two nodes, to begin with [rad] and at least, squared [rad²]."""
TRIM_RAD, GAIN = 0.01, 0.5
"""What a trim turns it between two nodes [rad], and how far its answer may be from the command [-], 1σ."""
STILL, LIVELY = 0.05, 0.3
"""Shares of the command that a picture that stands, and one that wind moves, show at most and at least [-]."""
MOVES, ANSWERS = 16.0, 0.5
"""A position that leaves its way by so much more than its noise, squared, moves [-]; with so much of the command, it
answers."""
SWEPT_M, SWEPT_S = 0.01, 1.0
"""A position that leaves its way by so much [m] is moved, and what commands do against that for so long [s] is no push
against a position that stands."""
SHOCK_M, SHOCK_S = 0.045, 0.35
"""A position that leaves its way by so much [m], 9 m/s², was struck, or is not the vehicle's: nothing is done in haste
for so long [s]."""
LEAP_M, LEAP_NOISES, LEAP_M_S2, LEAP_S = 0.0015, 7.0, 1.8, 0.035
"""A pose leaps that is so much [m], so many times its noise [-], and by what a gust makes of it [m/s²], farther off its
way than the one before, which came no longer ago than this [s]: where one is missing, so may commands be. Where one
was missing within the last second, too, poses get lost on their way alone, and up to 1.25 of 45 ms pass."""
LEAP_LOOKS_S, LEAP_USUAL, LEAP_MOST_S, LEAP_LATE = 0.0095, 0.02, 0.045, 1.25
"""Of what comes more often than this [s] all since are summed up: from one of 240 in a second to the next nothing goes
far. Where few come, the one before came up to so many times [-] as long ago as is usual, which is averaged with this
share of each, and at most so long [s]."""
ARREST_M, ARREST_S, STANDS_M = 0.018, 0.4, 0.01
"""A position that leaves its way by so much more than commands make it [m], 4 m/s², and then for so long [s] stays
within so much [m] has been stopped dead: no wind does that."""
FILTER_NOISE = 2.0
"""The filter's innovation has so much of a pose's own noise [-]."""
RESTS_M, RESTS_MORE, RESTS_S = 0.001, 9.0, 5.0
"""A position that stands moves by so much from node to node [m], and more counts up to so much of the mean square so
far [-], as a single leap is no wander; the mean of so long counts [s]."""
WANDERS_M = 0.001
"""A height that wanders by more from node to node [m] is not asked near the floor whether it stands or stays behind."""
ASTRAY_M = 0.5
"""However long it wanders, it does not go farther [m]: something holds it, as GPS or a barometer."""
HEADING_S, HEADING_RAD_S = 0.7, 0.25
"""Time constant of a turn about the vertical that no command asks for [s], and what convicts [rad/s]: 14°/s."""
STRAYS_RAD_S = 0.05
"""Slower is no turn that nobody asked for [rad/s]."""
YAW_LATE_S = 0.55
"""So late may a turn about the vertical follow its command [s]: PX4 and ArduPilot were seen to take 0.35."""
COORDINATE_M, COORDINATE_NOISES, COORDINATE_FOLLOWS, BRAKED_S, COORDINATE_S = 0.0005, 1.0, 0.2, 0.8, 2.0
"""A coordinate stands whose average from node to node stays within so much [m] and so many times its noise [-] of where
it was, which follows by the third [-], for the last time [s]: single poses of one that moves do so by chance, too. What
stands for less counts by the fourth power of that; in the first [s] it may still be braked."""
LEANS_M_S2, LEANS_S, LEANS_SLOWLY_S = 0.5, 0.25, 6.0
"""Meanwhile the push along it, averaged over the first time [s], leaves its average over the second [s] by so much
[m/s²]: no wind rises so fast and leaves no trace."""
LEANS_DOWN = 0.3
"""What counts of it down [-]: a battery that sags raises the thrust, and leaves no trace either."""
STANDS_ALONG = (
    *((math.cos(k * math.pi / 16), math.sin(k * math.pi / 16), 0.0, 1.0) for k in range(16)),
    (0.0, 0.0, 1.0, LEANS_DOWN),
)
"""Directions along which a position may stand while it moves across them, NED, and what counts of it there [-]: what a
camera does not see lies along its own axis, which need not be north or east."""
NO_POSES = (0.0, 0.0, 0.0, 0)
"""The sum of no positions [m], and how many they are."""
CLIMB_S, LOW_M, ROSE_M, ROSE_M_S, RISES_M_S, RISES_NODES = 2.0, 0.15, 0.01, 0.1, 0.03, 5
"""For so long after lift-off [s], and lower above it than the second [m], a height that has risen by so much [m], so
fast [m/s], and then no faster than that [m/s] for so many nodes stands: nobody flies so low, and a gust that just
carries the vehicle passes through that speed."""
BELOW_M = 0.06
"""It does not go so far below where it left the floor [m]."""
BEHIND_M, BEHIND_M_S2, BEHIND_TO_M = 0.06, 1.2, 0.25
"""Up to the third above it [m], it is behind where thrust must have lifted it by no more than the first [m] and what
wind, and a hover thrust that was measured on the floor's cushion, make of it [m/s²]."""
LED_S = 1.0
"""So long after it was moved by something else than commands it may still be in somebody's hand [s]."""
LATE_LOOKS, LATE_NODES = 0.3, 3
"""From this share of what convicts by attitude on a lateness is looked for [-]; it is one in so many nodes on end."""
LATE_EXPLAINS = 0.35
"""A lateness explains the turns where it leaves less than this share of their power [-]."""
LAGS_S = 1.2
"""Turns of so long are kept to look for a lateness in them [s]."""
LATENCY_MEMORY_S = 20.0
"""What is older counts less [s]."""
SLOW_S = 0.5
"""What differs for longer than this is no latency [s]."""
SURE = 4.0
"""So many deviations are no chance: there are many looks in a flight."""
RESPONSE_LEAST_S = 0.010
"""Less of a response is left to rates that no lag and delay describe [s]."""
AGAIN_S = 0.010
"""It is told again where it has changed by so much [s]."""
RESPONSE_LOOKS = 200
"""Poses that are looked at, before anything is said."""
LOOK_S = 0.02
"""Poses that come faster than this see the same turn again: they are no more looks than one of this length [s]."""


class PoseEvidence(NamedTuple):
    """What speaks against the poses, as shares of what convicts."""

    attitude: float
    """They do not turn as the commands turn the vehicle."""
    axes: float
    """They move as a mirrored or turned image of it."""
    heading: float
    """They turn about the vertical, and no command asks for that."""
    still: float
    """They stand where the vehicle is pushed: never more than a suspicion."""
    push: float = 0.0
    """They show a small part of what pushes the vehicle, or take a push that no wind gives: a suspicion, too."""

    @property
    def suspicious(self) -> bool:
        """Whether nothing should be learnt from the poses."""
        turns = self.attitude >= SUSPECTS or self.heading >= HEADING_SUSPECTS
        stands = self.still >= STILL_SUSPECTS or self.push >= PUSH_SUSPECTS
        return turns or stands or self.axes >= IMAGE_SUSPECTS


class Obedience:
    """One flight's. Fed with each pose and what the commands did since the last one."""

    __slots__ = (  # with so many, a dictionary is slow
        "_answer", "_arrest", "_asked", "_attitude", "_begun_s", "_between", "_climb_m_s", "_down", "_flown",
        "_from_down", "_from_s", "_gaps_s", "_gravity", "_half_s", "_halves", "_heading", "_hole_s", "_holes_s",
        "_hover_share", "_images", "_last", "_lates", "_leant", "_leaps_s", "_leapt_s", "_moved_s", "_newest_s",
        "_node_s", "_noise_m", "_off", "_off_s", "_offs", "_passed", "_per_newton", "_pitch", "_place", "_push",
        "_pushed", "_quarter", "_quarters", "_resets", "_rested", "_rests", "_rivals", "_roll", "_rose", "_seen_x",
        "_seen_y", "_seen_z",
        "_shock_s", "_shocks_s", "_silent", "_since_down", "_speed", "_still", "_stood", "_stopped_s",
        "_strays", "_stuck", "_swept_s", "_swift", "_told_x", "_told_y", "_told_z", "_turns", "_upset", "_usual_s",
        "_wander", "_wander_m", "answered", "asks", "calm_s", "evidence", "late_s", "led_s", "told_turn", "windows",
    )  # fmt: skip

    def __init__(self, mass_kg: float, gravity: float) -> None:
        """Take the vehicle's mass as told [kg] and g [m/s²]."""
        self._per_newton, self._gravity = -1.0 / mass_kg, gravity  # an impulse is told against the thrust
        self._pushed: Vec3 = (0.0, 0.0, 0.0)
        self._passed = NO_POSES
        self.told_turn: Vec3 = (0.0, 0.0, 0.0)
        """By what the commands have turned it since the pose before, in the body's axes [rad]."""
        self._speed: Vec3 = (0.0, 0.0, 0.0)
        self._roll, self._pitch = _TiltAxis(), _TiltAxis()
        self._images = Images()
        self._halves: deque[tuple[float, Vec3, Vec3]] = deque(maxlen=HALVES)
        """Half-way between the nodes, each instant [s] with what was seen and what was commanded [m, NED]."""
        self._between: Images | None = None
        """Those of the half-way instants, while an image is suspected: what it drives away is soon twice as fast."""
        self._rested: Pose | None = None
        self._rests, self._resets = 0.0, 0
        self._wander = self._wander_m = 0.0
        self.windows = 0
        """Nodes looked at."""
        self.calm_s = -math.inf
        """When nothing was suspicious last: poses of before are to be trusted [s]."""
        self.answered = 0.0
        """What speaks for a vehicle whose attitude answers, since it began or poses were missing for long."""
        self.led_s = -math.inf
        """When it was last seen to move, after it had left its way by no command [s]."""
        self.late_s = 0.0
        """By how much the poses turned out to be older than they say, by what the commands did [s]."""
        self._turns: deque[tuple[float, float, float, float, float]] = deque()
        self._asked: deque[tuple[float, float]] = deque()
        self.restart()

    def lift_off(self, hover_share: float, climb_m_s: float) -> None:
        """It has just left the floor, where the share ``hover_share`` of the weight seems to hover."""
        self.restart()
        self._hover_share, self._climb_m_s = hover_share, climb_m_s

    def restart(self) -> None:
        """It is let go in the air: what was seen before counts no more."""
        self.forget()
        self._rivals = Rivals(CLIMB_BEGINS)
        self._flown, self._begun_s = 0, math.inf
        self._hover_share = self._climb_m_s = self._down = self._from_down = self._since_down = self._from_s = math.nan
        self._rose = False

    def forget(self) -> None:
        """What was seen before counts no more, but how long it flies, and from where: it has not heard the commands."""
        self._attitude = self._quarter = self._still = self._heading = 0.0
        self._quarters = [0.0, 0.0]
        self._last: Quat | None = None
        self._noise_m = math.inf
        self._arrest: Pose | None = None
        self._answer, self._silent = PositionAnswer(), 0.0
        self.asks = False
        """Whether the position is asked, by a small turn to and fro."""
        self._stopped_s = 0.0
        self._lates = self._stuck = 0
        self._strays = False
        self._place: Vec3 = (0.0, 0.0, 0.0)
        self._roll.restart()
        self._pitch.restart()
        self._moved_s = self._swept_s = self._shock_s = self._shocks_s = self._newest_s = -math.inf
        self._hole_s = self._holes_s = self._gaps_s = self._leapt_s = self._leaps_s = -math.inf
        self._off = self._offs = self._off_s = 0.0
        self._usual_s = LEAP_S / LEAP_LATE
        self._images.restart()
        self._rivals = Rivals()
        self._push = 0.0
        self._forget_between()
        self._turns.clear()
        self._asked.clear()
        self._leant = 0.0
        self.evidence = PoseEvidence(0.0, 0.0, 0.0, 0.0)
        """As it stands."""

    def _forget_between(self) -> None:
        """What was seen half-way between the nodes counts no more."""
        self._halves.clear()
        self._half_s = -math.inf
        self._between = None

    def rest(self, pose: Pose) -> None:
        """Take one pose of a vehicle that stands on the floor: it moves only by how its position is measured."""
        last = self._rested
        if last is None or pose.reset_count != last.reset_count or pose.time_s - last.time_s > GAP_S:
            self._rested = pose
        elif pose.time_s - last.time_s >= NODE_S - 1e-6:
            moved = math.dist(pose.position_ned, last.position_ned)
            most = RESTS_MORE * max(self._rests, RESTS_M * RESTS_M)
            self._rests += (min(moved * moved / 3.0, most) - self._rests) * (NODE_S / RESTS_S)
            self._rested = pose

    def astray_m(self, since_s: float) -> float:
        """How far an estimate that wanders may have gone in so long [s]: two sigma [m]."""
        return min(2.0 * math.sqrt(0.5 * self._wander * max(since_s, 0.0) / NODE_S), ASTRAY_M)

    def stands(self, now_s: float) -> bool:
        """Whether the position has not moved by itself or answered a command of late."""
        still = now_s - self._moved_s > 1.5 * NODE_S and now_s - self._swept_s > SWEPT_S
        return still and self._images.nodes > SETTLES

    def is_led(self, now_s: float) -> bool:
        """Whether something else than the commands moves it, as a hand does, at ``now_s`` [s]."""
        return now_s - self.led_s < LED_S

    def pose(
        self, pose: Pose, before: Motion, given: ActuatorResponse, dt: float, noise_m: float, *,
        counts: bool, upset: bool = False, off_m: float = 0.0,
    ) -> bool:  # fmt: skip
        """Take one pose; whether it was a node, with new evidence.

        Args:
            pose: the newest.
            before: the motion at the pose before.
            given: what the commands have made of that since.
            dt: time since then [s].
            noise_m: position noise of the poses as measured, 1σ per axis [m].
            counts: False near the floor, which holds the vehicle, too.
            upset: whether the disturbance that is found has changed as no gust changes it.
            off_m: how far it is from where the estimate was going [m].
        """
        # Written out, as this is done with every pose: both turns in the body's axes, twice a quaternion's vector.
        w, x, y, z = before.attitude
        p, q, r, s = given[0]  # goes on from there: no sign to mind
        self.told_turn = told_x, told_y, told_z = (
            2.0 * (w * q - x * p - y * s + z * r),
            2.0 * (w * r + x * s - y * p - z * q),
            2.0 * (w * s - x * r + y * q - z * p),
        )
        last, self._last = self._last, pose.attitude
        if dt > HOLE_S:
            if pose.time_s - self._holes_s > HOLES_S:  # what goes on is how this source tells
                # Poses were missing: the filters must find their way again.
                self._hole_s = pose.time_s
                self._images.nodes = min(self._images.nodes, SETTLES - 3)
                self._forget_between()
            self._holes_s = pose.time_s
        most_m = self._noise_m * (1.0 + NOISE_RISES * dt)
        self._noise_m = noise_m = noise_m if noise_m < most_m else most_m
        if last is None or dt > GAP_S or not counts or pose.reset_count != self._resets:
            self._off, self._offs, self._off_s = off_m, 0.0, 0.0
            self._begin(pose)
            return False
        w, x, y, z = last
        p, q, r, s = pose.attitude
        k = 2.0 if w * p + x * q + y * r + z * s > 0.0 else -2.0
        self._seen_x += k * (w * q - x * p - y * s + z * r)
        self._seen_y += k * (w * r + x * s - y * p - z * q)
        self._seen_z += k * (w * s - x * r + y * q - z * p)
        self._told_x += told_x
        self._told_y += told_y
        self._told_z += told_z
        x, y, z = pose.position_ned
        a, b, c, n = self._passed
        self._passed = (a + x, b + y, c + z, n + 1)
        self._usual_s += LEAP_USUAL * ((dt if dt < LEAP_MOST_S else LEAP_MOST_S) - self._usual_s)
        self._offs += off_m
        self._off_s += dt
        if self._off_s >= LEAP_LOOKS_S:
            further, since_s = self._offs - self._off, self._off_s
            self._off, self._offs, self._off_s = self._offs, 0.0, 0.0
            near = since_s <= max(LEAP_S, LEAP_LATE * self._usual_s)
            if not near:  # as with holes: what goes on is how this source tells
                near = since_s <= LEAP_LATE * LEAP_MOST_S and pose.time_s - self._gaps_s <= HOLES_S
                self._gaps_s = pose.time_s
            if further > LEAP_M and near:
                further -= LEAP_NOISES * max(noise_m, self._wander_m) + LEAP_M_S2 * since_s * since_s
                if further > LEAP_M:
                    self._leaps(pose.time_s)
        half = 0.5 * dt
        m, g, (_, _, _, (ix, iy, iz), (sx, sy, sz)) = self._per_newton, self._gravity, given
        (px, py, pz), (vx, vy, vz) = self._pushed, self._speed
        self._pushed = (px + dt * vx + m * sx, py + dt * vy + m * sy, pz + dt * (vz + half * g) + m * sz)
        self._speed = (vx + m * ix, vy + m * iy, vz + m * iz + g * dt)
        self._upset = upset
        h = pose.time_s - self._node_s
        if h < NODE_S - 1e-6 and dt <= HOLE_S:
            if h >= HALF_NODE_S and self._half_s <= self._node_s:
                self._look_between(pose)
            return False
        self._node(pose, h, noise_m)
        return True

    def _leaps(self, now_s: float) -> None:
        """It is where nothing pushes a vehicle from one pose to the next."""
        if now_s - self._leaps_s > SWEPT_S:  # what goes on leaping is no leap
            self._leapt_s = now_s
        self._leaps_s = now_s

    def lateness_s(self) -> float:
        """By how much later than they say the poses follow the commands [s]; 0 where no lateness explains them.

        The newest turns are held against those that the commands must have made up to half a second earlier.
        """
        turns = list(self._turns)
        if len(turns) < 8:
            return 0.0
        h = (turns[-1][0] - turns[0][0]) / (len(turns) - 1)
        newest = turns[len(turns) // 2 :]
        first = len(turns) - len(newest)
        power = sum(one[1] ** 2 + one[2] ** 2 for one in newest)
        left: list[float] = []
        for back in range(min(first, int(0.5 / h)) + 1):
            told = turns[first - back : len(turns) - back]
            left.append(
                sum((s[1] - t[3]) ** 2 + (s[2] - t[4]) ** 2 for s, t in zip(newest, told, strict=True))
                / max(power, 1e-9)
            )
        best = min(range(len(left)), key=left.__getitem__)
        return best * h if left[best] < LATE_EXPLAINS and left[best] < 0.5 * left[0] else 0.0

    def _begin(self, pose: Pose) -> None:
        self.answered = 0.0
        z = pose.position_ned[2]
        if self._begun_s == math.inf:
            self._begun_s = pose.time_s
            if self._climb_m_s > 0.0:
                self._from_down, self._since_down, self._from_s = z, z, pose.time_s
        else:  # what the commands did since is not known: by now it may be at rest
            self._since_down, self._from_s, self._climb_m_s = z, pose.time_s, 0.0
            if pose.reset_count != self._resets:
                self._from_down = math.nan
        self._resets, self._node_s, self._down = pose.reset_count, pose.time_s, z
        self._seen_x = self._seen_y = self._seen_z = self._told_x = self._told_y = self._told_z = 0.0
        self._pushed = self._speed = (0.0, 0.0, 0.0)
        self._images.begin(pose.time_s, pose.position_ned, self._pushed)
        self._rivals.begin(pose.position_ned, self._pushed)
        self._stood = _Coordinates(pose.position_ned, pose.time_s)
        self._passed = NO_POSES
        self._swift = self._speed
        self._forget_between()

    def _look_between(self, pose: Pose) -> None:
        """Half-way between two nodes: where an image is suspected, it is looked for here, too."""
        halves, images, fade = self._halves, self._between, 1.0 - NODE_S / FADE_S
        self._half_s = pose.time_s
        halves.append((pose.time_s, pose.position_ned, self._pushed))
        if self._images.across < LOOKS and (images is None or images.across < LOOKS):
            self._between = None
            return
        if images is None:
            self._between = images = Images(self._images.wind)
            images.begin(*halves[0])
            for half in islice(halves, 1, len(halves) - 1):
                images.node(*half, fade, NODE_S)
        if len(halves) > 1:
            images.wander = self._wander
            images.node(*halves[-1], fade, NODE_S)
            self._judge()

    def _judge(self) -> None:
        """Weigh what speaks against the poses."""
        newest_s, push, still, leant = self._newest_s, self._push, self._still / CONVICTS, self._leant
        still = max(still, leant, self._silent)
        if newest_s - self._shock_s < SHOCK_S:
            still = max(still, STOPPED)
        if self._stopped_s > NODE_S:
            still = max(still, STOPPED if self._stopped_s < ARREST_S else 1.0)
        heading = abs(self._heading) / HEADING_RAD_S
        attitude = (self._attitude if self._attitude > self._quarter else self._quarter) / CONVICTS
        across, down = self._images.across, self._images.down  # a tether pulls down as a mirrored axis: no haste there
        if self._between is not None:
            across = max(across, self._between.across)
        axes = 0.0
        if across > 0.0 or down > 0.0:
            convicts = EARLY_CONVICTS if self._flown < EARLY else IMAGE_CONVICTS
            axes = max(across / (UPSET_CONVICTS if self._upset else convicts), down / convicts)
            if self._upset and across >= UPSET_SUSPECTS:
                axes = max(axes, IMAGE_SUSPECTS)
        # What has leapt is suspect until it is seen how it goes on, and longer where that is as a rival would.
        if newest_s - self._leapt_s < (STAYS_S if push >= LEAPS_AS else 1.5 * NODE_S):
            push = max(push, PUSH_SUSPECTS)
        self.evidence = PoseEvidence(attitude, axes, heading, still, push)

    def _node(self, pose: Pose, h: float, noise_m: float) -> None:
        now_s, place, pushed = pose.time_s, pose.position_ned, self._pushed
        self._node_s = self._newest_s = now_s
        self.windows += 1
        self._flown += 1
        fade, learn = 1.0 - h / FADE_S, h / LEARN_S
        x, y, cx, cy = self._seen_x, self._seen_y, self._told_x, self._told_y
        self._heading += h / HEADING_S * (self._strays_by(now_s, h) - self._heading)
        self._seen_x = self._seen_y = self._seen_z = self._told_x = self._told_y = self._told_z = 0.0
        self._turns.append((now_s, x, y, cx, cy))
        while self._turns[0][0] < now_s - LAGS_S:
            self._turns.popleft()
        calm = self._attitude < CALM
        says = self._roll.node(x, cx, learn, calm) + self._pitch.node(y, cy, learn, calm)
        if says > 0.0 and now_s - self._hole_s < UNHEARD_S:
            says *= UNHEARD
        if says > 0.0 or self._attitude > 0.0:  # else it stays zero, as nearly always
            most = CAP if self._attitude > CALM else FIRST
            self._attitude = max(0.0, self._attitude * fade + max(-CAP, min(says, most)))
        self._look_quarters(x, y, cx, cy, fade)
        answered = self.answered - (says if says > -CAP else -CAP)
        self.answered = answered if answered > 0.0 else 0.0
        if self._flown == 1:
            # White noise moves it by √2 of itself from node to node; much more than that is an estimate that wanders.
            self._wander = max(2.0 * (self._rests - 5.0 * noise_m * noise_m), 0.0)
            self._wander_m = math.sqrt(self._wander)
        images, wander = self._images, self._wander
        images.wander = wander
        seen, told = images.node(now_s, place, pushed, fade, NODE_S)
        if images.nodes > SETTLES:
            shakes_m = FILTER_NOISE * noise_m
            shakes_m = math.sqrt(shakes_m * shakes_m + wander)
            self._stands(pose, seen, told, fade, shakes_m)
            self._silent = self._answer.node(now_s, h, seen, told, shakes_m, asked=self.asks)
        if now_s - h < self._hole_s <= now_s:
            self._rivals.begin(place, pushed)
        else:
            shakes_m = NOISES * noise_m
            shakes_m = math.sqrt(shakes_m * shakes_m + wander)
            climbs, leapt = now_s - self._begun_s <= CLIMB_S + 1e-6, now_s - self._leapt_s < h
            turns = self._attitude < LATE_LOOKS * CONVICTS
            self._push = self._rivals.node(place, pushed, h, shakes_m, leapt, climbs=climbs, turns=turns)
            if climbs and self._wander_m < WANDERS_M:
                self._push = max(self._push, self._climb(now_s, place[2], h, noise_m))
        self._lean(now_s, h, COORDINATE_M + COORDINATE_NOISES * noise_m)
        self._judge()
        attitude, axes, heading, still, push = self.evidence
        if (attitude >= LATE_LOOKS or self._lates) and self.late_s == 0.0:
            late_s = self.lateness_s()
            self._lates = self._lates + 1 if late_s > 0.0 else 0
            if self._lates >= LATE_NODES:
                self.late_s = late_s
        turns, stands = attitude >= CALM_SHARE or heading >= HEADING_SUSPECTS, still >= CALM_SHARE
        if not (turns or stands or axes >= CALM_SHARE or push >= HEADING_SUSPECTS):
            self.calm_s = now_s

    def _strays_by(self, now_s: float, h: float) -> float:
        """How fast it has turned about the vertical, beyond all that was asked for of late [rad/s]."""
        asked, seen, told = self._asked, self._seen_z / h, self._told_z / h
        asked.append((now_s, told))
        while asked[0][0] < now_s - YAW_LATE_S:
            asked.popleft()
        if -STRAYS_RAD_S < seen - told < STRAYS_RAD_S:
            return 0.0
        rates = [rate for _, rate in asked]
        low, high = min(rates), max(rates)
        return seen - low if seen < low else seen - high if seen > high else 0.0

    def _climb(self, now_s: float, down: float, h: float, noise_m: float) -> float:
        """What speaks for a height that stands or stays behind, just off the floor, where it does not wander."""
        rises, self._down = (self._down - down) / h, down
        high_m, since_s = self._from_down - down, now_s - self._from_s
        fallen_m = 0.5 * self._gravity * since_s * since_s
        lifted_m = (fallen_m - self._pushed[2]) / self._hover_share - fallen_m + self._climb_m_s * since_s
        behind_m = BEHIND_M + 3.0 * noise_m + 0.5 * BEHIND_M_S2 * since_s * since_s
        if high_m < -BELOW_M or (high_m < BEHIND_TO_M and lifted_m - (self._since_down - down) > behind_m):
            return 1.0
        self._rose = self._rose or (rises > ROSE_M_S and high_m > ROSE_M + 3.0 * noise_m)
        stands = self._rose and ROSE_M < high_m < LOW_M and abs(rises) < RISES_M_S + 3.0 * noise_m / h
        self._stuck = self._stuck + 1 if stands else 0
        return 1.0 if self._stuck >= RISES_NODES else PUSH_SUSPECTS if self._stuck == RISES_NODES - 1 else 0.0

    def _lean(self, now_s: float, h: float, within_m: float) -> None:
        """What one node says of each coordinate that stands within so much [m], while the push along it changes."""
        (x, y, z, n), (u, v, w), (p, q, r) = self._passed, self._speed, self._swift
        self._passed, self._swift = NO_POSES, self._speed
        place, push = (x / n, y / n, z / n), ((u - p) / h, (v - q) / h, (w - r) / h)
        most = self._stood.node(place, push, now_s, h, within_m)
        self._leant = min(most / LEANS_M_S2, 1.0) if most > 0.5 * LEANS_M_S2 else 0.0

    def _stands(self, pose: Pose, y: Vec3, c: Vec3, fade: float, noise_m: float) -> None:
        """What one node says of a position that stands; ``noise_m`` is the filter's own [m]."""
        now_s, place, strays = pose.time_s, pose.position_ned, False
        left = math.hypot(*y)
        leaves = left - math.hypot(*c)
        far = math.dist(self._place, place) > SWEPT_M
        self._place = place
        if far:  # what goes somewhere does not stand, however steadily it goes
            self._moved_s = now_s
            says = -CAP
            if self._strays:  # it left its way, and moves on: no picture does that
                self.led_s = now_s
        else:
            says = self._still_says(now_s, y, c, noise_m * noise_m)
        if left > SWEPT_M:
            self._swept_s = now_s
            strays = math.dist(y, c) > SWEPT_M
            if leaves > SHOCK_M + 3.0 * self._wander_m:
                if now_s - self._shocks_s > SWEPT_S:  # what goes on pushing is no shock
                    self._shock_s = now_s
                self._shocks_s = now_s
        if says > 0.0 or self._still > 0.0:
            self._still = max(0.0, self._still * fade + max(-CAP, min(says, STILL_CAP)))
        self._strays = strays and far
        arrest = self._arrest
        if arrest is not None:
            moved = math.dist(arrest.position_ned, place)
            self._stopped_s = now_s - arrest.time_s
            if moved > STANDS_M + 2.0 * noise_m or self._stopped_s > 2.0 * ARREST_S:
                self._arrest, self._stopped_s, self.led_s = None, 0.0, now_s
        if leaves > ARREST_M:
            # Across a wind that turns brings it to a stand, too; a cable stops what climbs.
            stops = now_s - self._leaps_s < 2.0 * NODE_S or abs(y[2]) > 0.5 * left
            gusts = 2.0 * (math.sqrt(max(self._images.wind)) - WIND_M)
            if stops and leaves > ARREST_M + 3.0 * self._wander_m + gusts:
                # It leaves its way, and not by our doing: a gust, a hand, or the end of what was true.
                self._arrest = pose

    def _still_says(self, now_s: float, y: Vec3, c: Vec3, own: float) -> float:
        """What one node says for a position that stands, where it goes nowhere; ``own`` is the filter's noise² [m²]."""
        says = 0.0
        for seen, told in zip(y, c, strict=True):
            square, asked = seen * seen, told * told
            b = own + LIVELY * LIVELY * asked
            if square > MOVES * own:
                if square > ANSWERS * ANSWERS * asked:
                    self._moved_s = now_s
                if square > b:
                    says -= CAP  # whatever moves it, it is no picture
                    continue
            a = own + STILL * STILL * asked
            says += 0.5 * math.log(b / a) - 0.5 * square * (1.0 / a - 1.0 / b)
        return says

    def _look_quarters(self, x: float, y: float, cx: float, cy: float, fade: float) -> None:
        """What one node says of an object whose axes are a quarter turn off: roll is seen as pitch."""
        x, y = x - self._roll.trim, y - self._pitch.trim
        ex, ey, seen = x - cx, y - cy, x * x + y * y
        rest = min(ex * ex + ey * ey, seen)
        best = seen + cx * cx + cy * cy - 2.0 * abs(x * cy - y * cx)
        if best >= rest and self._quarter == 0.0:
            return  # it says nothing, as nearly always
        for i, sign in enumerate((1.0, -1.0)):
            off = (x - sign * cy) ** 2 + (y + sign * cx) ** 2
            says = (rest - off) / (2.0 * max(self._roll.variance, self._pitch.variance, off / UNEXPLAINED))
            self._quarters[i] = max(0.0, self._quarters[i] * fade + max(-CAP, min(says, FIRST)))
        self._quarter = max(self._quarters)


class _TiltAxis:
    """Roll or pitch: how it turns from node to node, and the vehicle's trim about that axis."""

    __slots__ = ("_before", "_trim_variance", "trim", "variance")

    def __init__(self) -> None:
        self.variance = TURN_NOISE_RAD**2
        """Of the noise of a turn [rad²]."""
        self.trim, self._trim_variance = 0.0, TRIM_RAD**2
        """What a constant offset of the rates turns it between two nodes [rad], and its variance."""
        self.restart()

    def restart(self) -> None:
        """No command is known yet."""
        self._before = 0.0

    def node(self, y: float, told: float, learn: float, calm: bool) -> float:
        """What one node says, a turn by ``y`` where one by ``told`` was commanded [rad]; learns the trim if calm."""
        c = told + self.trim
        r = y - c
        slip = SLIP * (c - self._before)
        self._before = c
        variance, best, as_seen = self.variance, r * r, y * y
        best = best if best < as_seen else as_seen
        if best > variance or variance > TURN_FLOOR_RAD2:
            self.variance = max(variance + learn * (min(best, 9.0 * variance) - variance), TURN_FLOOR_RAD2)
        if calm:
            # A command of which we don't know how much arrives says little of what turns it beside.
            trim, unsure = self._trim_variance, GAIN * told
            noise = variance + unsure * unsure
            gain, most = trim / (trim + noise), 3.0 * math.sqrt(trim + variance)
            gain = gain if gain > learn else learn
            self._trim_variance = (1.0 - gain) * trim
            self.trim += gain * (r if -most < r < most else math.copysign(most, r))
        # A rate lag that is told a little wrong shifts what a changing command does by a part of a node.
        answer, noise = ANSWER * c, max(variance, best / UNEXPLAINED, slip * slip)
        return answer * (answer - 2.0 * y) / (2.0 * noise)


class _Coordinates:
    """Coordinates of the position, of which any may stand, and the push along each."""

    __slots__ = ("_all",)

    def __init__(self, position: Vec3, time_s: float) -> None:
        """It is at ``position`` [m, NED] at an instant [s]."""
        x, y, z = position
        # Each with where it stands, since when, the push on average of late, for longer, and the most it has left that.
        self._all = [(a * x + b * y + c * z, time_s, 0.0, 0.0, 0.0) for a, b, c, _ in STANDS_ALONG]

    def node(self, position: Vec3, pushed: Vec3, time_s: float, h: float, within_m: float) -> float:
        """How far a push has left its average along what stands, or less if that is not long; 0 if not [m/s²].

        Args:
            position: where it was on average since the last call [m, NED].
            pushed: what the commands push, since the last call [m/s², NED].
            time_s: now [s].
            h: time since the last call [s].
            within_m: it stands within so much [m].
        """
        (x, y, z), (p, q, r) = position, pushed
        quick, slowly = h / LEANS_S if h < LEANS_S else 1.0, h / LEANS_SLOWLY_S
        most, kept = 0.0, []
        for (a, b, c, counts), (place0, since0_s, fast0, slow0, leant0) in zip(STANDS_ALONG, self._all, strict=True):
            now = a * x + b * y + c * z
            stands = -within_m <= now - place0 <= within_m
            place, since_s = (place0 + COORDINATE_FOLLOWS * (now - place0), since0_s) if stands else (now, time_s)
            fast = slow = fast0 + quick * (a * p + b * q + c * r - fast0)
            leant, stood_s = 0.0, time_s - since_s
            if stood_s >= BRAKED_S:
                slow = slow0 + slowly * (fast - slow0)
                leans = abs(fast - slow) * (min(stood_s, COORDINATE_S) / COORDINATE_S) ** 4
                leant = max(leant0, leans)  # a law that is told of it pushes no more
                most = max(most, counts * leant)
            kept.append((place, since_s, fast, slow, leant))
        self._all = kept
        return most


_Sides = tuple[float, float, float, float]


class LatencyFit:
    """The time by which one signal e comes later than another, by ġ of that: least squares of e = -δ ġ."""

    def __init__(self, memory_s: float, looks: float) -> None:
        """Nothing seen; what is older than ``memory_s`` [s] counts less, and ``looks`` are needed to say anything."""
        self._memory_s, self._looks = memory_s, looks
        self._slow = (0.0, 0.0, 0.0, 0.0)
        """Averages of e and of ġ, x and y of each."""
        self._moved = self._both = self._off = 0.0
        """Σ ġ², -Σ e ġ, Σ e² over the last seconds."""
        self._count = 0.0

    def begin(self, now: _Sides) -> None:
        """Begin again with what differs slowly: e and ġ, x and y of each."""
        self._slow = now

    def add(self, dt: float, looks: float, now: _Sides) -> None:
        """Take e and ġ, x and y of each, ``dt`` [s] after the last ones; they count as so many looks."""
        gain = dt / SLOW_S
        (a, b, c, d), (e, f, u, v) = self._slow, now
        self._slow = a, b, c, d = a + gain * (e - a), b + gain * (f - b), c + gain * (u - c), d + gain * (v - d)
        e, f, u, v = e - a, f - b, u - c, v - d
        keep = 1.0 - dt / self._memory_s
        self._moved = keep * self._moved + u * u + v * v
        self._both = keep * self._both - e * u - f * v
        self._off = keep * self._off + e * e + f * f
        self._count = keep * self._count + looks

    @property
    def estimate(self) -> tuple[float, float] | None:
        """The time, below 0 where it comes earlier, and one deviation of that [s]; None at first."""
        if self._count < self._looks or self._moved <= 0.0:
            return None
        late = self._both / self._moved
        return late, math.sqrt(max(self._off / self._moved - late * late, 0.0) / self._count)

    def late_s(self, least_s: float) -> float | None:
        """The same [s]; None while that could be chance, or is not more than ``least_s``."""
        late, spread = self.estimate or (0.0, math.inf)
        return late if abs(late) > max(least_s, SURE * spread) else None


class ResponseLatency:
    """One vehicle's, while it flies. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing seen."""
        self._model: tuple[float, float] | None = None
        self._slow = (0.0, 0.0)
        self._fit = LatencyFit(LATENCY_MEMORY_S, RESPONSE_LOOKS)
        self._said_s = 0.0

    def pose(self, attitude: Quat, told_turn: Vec3, dt: float) -> None:
        """Take one pose.

        Args:
            attitude: what it shows, body FRD to world NED.
            told_turn: :attr:`Obedience.told_turn` [rad].
            dt: time since the pose before [s].
        """
        a, b, c = third_row(attitude)
        model = self._model
        if model is None or not 0.0 < dt <= GAP_S:
            self._model = a, b
            self._fit.begin((0.0, 0.0, 0.0, 0.0))
            self._slow = 0.0, 0.0
            return
        p, q, r = told_turn
        u, v = (r * b - q * c) / dt, (p * c - r * a) / dt
        # Where these rates take it is drawn to what is seen as slowly as an average forgets: theirs is taken out, too.
        gain = dt / SLOW_S
        e, f = a - model[0] - dt * u, b - model[1] - dt * v
        self._model = a - (1.0 - gain) * e, b - (1.0 - gain) * f
        s, t = self._slow
        self._slow = s, t = s + gain * (u - s), t + gain * (v - t)
        self._fit.add(dt, min(dt / LOOK_S, 1.0), (e, f, u - s, v - t))

    @property
    def late_s(self) -> float | None:
        """How much later it turns than told, below 0 earlier [s]; None while that could be chance, or little."""
        return self._fit.late_s(RESPONSE_LEAST_S)

    def describe_news(self, by_attitude: Callable[[], tuple[float, float] | None]) -> str | None:
        """A line for the operator, where there is something that was not told yet.

        ``by_attitude`` tells how much later the poses alone are than told, and its deviation [s]; None where the
        vehicle's own attitude does not show it.
        """
        late = self.late_s
        if late is None:
            return None
        poses = by_attitude()
        rest = late - (poses[0] if poses else 0.0)
        if abs(rest) < RESPONSE_LEAST_S or abs(rest - self._said_s) < AGAIN_S:
            return None
        self._said_s = rest
        if poses is None:
            found = f"poses seem {describe_latency(rest)} than told, or the vehicle turns so"
            return f"{found}, by how it answers its commands: measure both (groundstation identify)"
        found = f"the vehicle turns {describe_latency(rest)} than told"
        return f"{found}: measure the lag and delay of its rates (groundstation identify)"


def describe_latency(late_s: float) -> str:
    """How much later than something else, or earlier where it is below 0 [s], in words."""
    return f"{abs(late_s) * 1e3:.0f} ms {'later' if late_s > 0.0 else 'earlier'}"
