"""Table of the sentences that an operator can read: id, severity, sentence with named numbers,
remedy. Sans-IO.

Code names the id and gives the numbers: ``notice("pose.late", age_ms=312.0, limit_ms=250.0)``.
Rooms below this one have tables of their own, which it takes in: ``links/text`` and
``groundstation/config``; ``sim/text`` adds its own. A sentence states the fact, then the number and
its limit; the remedy says what to do.
"""

from groundstation.config import CONFIG_NOTICES
from groundstation.core.messages.analysis_notices import ANALYSIS_NOTICES
from groundstation.core.messages.command_notices import COMMAND_NOTICES
from groundstation.core.messages.flight_notices import FLIGHT_NOTICES
from groundstation.core.messages.lab_notices import LAB_NOTICES
from groundstation.core.messages.pose_notices import POSE_NOTICES
from groundstation.core.messages.preflight_notices import PREFLIGHT_NOTICES
from groundstation.core.messages.screen_notices import SCREEN_NOTICES
from groundstation.core.messages.station_notices import STATION_NOTICES
from links.text import LINK_NOTICES, NoticeTemplate, Sentence, as_warnings

_TABLE: tuple[NoticeTemplate, ...] = (
    NoticeTemplate("pose.dropping", "poses are dropped: {why}"),
    NoticeTemplate("pose.steady_clock", "the tracker's clock is steady again"),
    NoticeTemplate("pose.none", "no poses: {why}"),
    NoticeTemplate("pose.few_dropped", "fewer than 1 % were dropped, {total} accepted"),
    NoticeTemplate("pose.dropped", "{count} of {total} poses were dropped, limit 1 %: {why}"),
    NoticeTemplate(
        "link.few_dropped",
        "fewer than 1 % of {total} messages were lost, and none came from an unknown sender",
    ),
    NoticeTemplate(
        "qualisys.too_old",
        "QTM at {server} speaks no version of its real-time protocol from {newest} down to "
        "{oldest}",
        "update QTM; QTM 2018.1, which speaks 1.18, is new enough",
    ),
    # Poses that do not respond to the commands (docs/explanation/trust.md).
    NoticeTemplate(
        "pose.suspect", "the poses are suspect: small motions test whether they respond"
    ),
    NoticeTemplate("pose.answers", "the poses respond again"),
    NoticeTemplate(
        "package.missing",
        'pose.kind = "{kind}" needs {package}, which is not installed',
        "{command}",
    ),
    *as_warnings(
        NoticeTemplate(
            "pose.unsteady_clock",
            "the tracker's clock stepped {count} times within {within_s:g} s, so its stamps do "
            "not tell how old a pose is",
            "in flight, land; then find out what sets the sender's clock",
        ),
        NoticeTemplate(
            "pose.stamp_rate",
            "the time stamps of the poses run {factor} times too {way}, limit {limit:g}",
            "{field} is expected in {unit}{looks_like}",
        ),
        NoticeTemplate(
            "code.slow",
            "{what} took {took_ms:.0f} ms, and poses that came meanwhile are not used, limit "
            "{limit_ms:.0f} ms",
            "make its step faster",
        ),
        NoticeTemplate("code.hangs", "it did not return within {limit_ms:.0f} ms"),
        NoticeTemplate(
            "code.hangs_making",
            "it did not return within {limit_s:.0f} s",
            "compute before the flight what takes long, and load it from a file",
        ),
        NoticeTemplate(
            "code.slow_end", "{slow}. No command left in time, and the link plays its bring-down"
        ),
        NoticeTemplate(
            "trajectory.derivative",
            "at {at_s:.2f} s its {name} is declared as {declared:.3g} {unit}, and by its {of} is "
            "{found:.3g} {unit}, or has another direction",
            "correct the {name} that it returns, its signs and axes: limits and fence are checked "
            "by it",
        ),
        NoticeTemplate(
            "trajectory.fence",
            "at {at_s:.2f} s the vehicle could not brake within the fence, by {short_m:.2f} m",
            "move it, slow it down, or correct [fence]",
        ),
        NoticeTemplate(
            "trajectory.period",
            "at {at_s:.1f} s it is {far_m:.2f} m outside of where it was in its first "
            "{span_s:.3g} s",
            "correct its period_s or joints_s, or give it a duration_s",
        ),
        NoticeTemplate(
            "pose.other_server",
            "the NatNet server replies from another address, {address}, and only the configured "
            "one is accepted",
            'write pose.server = "{address}:{port}"',
        ),
        NoticeTemplate(
            "pose.two_senders",
            "poses of the vehicle come from two addresses, {used} and {other}, and only those of "
            "the first are used",
            "end the program that should not send; see by `check --watch` that the right poses "
            "come",
        ),
        NoticeTemplate(
            "pose.origin_moves",
            "the source of the poses moved its origin {count} times within {within_s:g} s",
            "see that one estimator alone sends them, and that it has settled before you arm",
        ),
        NoticeTemplate(
            "link.truncated",
            "{count} of {total} MAVLink frames ({percent:.1f} %, limit 1 %) came in pieces of "
            "which some were lost",
            "a bridge or radio cuts frames over datagrams: have it send whole frames, lower the "
            "autopilot's stream rates, check the signal",
        ),
        NoticeTemplate(
            "link.bad_crc",
            "{count} of {total} MAVLink frames ({percent:.1f} %, limit 1 %) had a wrong checksum",
            "on a serial port check baud rate, wiring and signal; on a network find out what else "
            "sends to this port",
        ),
        NoticeTemplate(
            "link.unsigned",
            "{count} MAVLink messages came without a signature and were ignored",
            "give their sender the key of link.signing_key_file, or switch it off",
        ),
        NoticeTemplate(
            "link.bad_signature",
            "{count} MAVLink messages were signed with another key and were ignored",
            "compare the autopilot's key with link.signing_key_file; if they are the same, "
            "somebody forges messages",
        ),
        NoticeTemplate(
            "link.replayed",
            "{count} signed MAVLink messages had time stamps that were used before and were "
            "ignored",
            "somebody replays messages, or two senders sign with one system and link id: switch "
            "off all but the vehicle",
        ),
        NoticeTemplate(
            "link.other_address",
            "{count} datagrams came from another address than the vehicle's ({addresses}) and "
            "were ignored",
            "find out who else sends to this port, and give it another one",
        ),
        NoticeTemplate(
            "link.second_path",
            "{count} datagrams of the vehicle came by a second path ({addresses}) and were ignored",
            "end that path: commands go by the first",
        ),
        NoticeTemplate(
            "link.congested",
            "{count} of {total} messages to the vehicle ({percent:.1f} %, limit 1 %) did not "
            "leave, as the network had no room",
            "check the network's load and signal",
        ),
        NoticeTemplate(
            "link.full",
            "{count} of {total} messages to the vehicle ({percent:.1f} %, limit 1 %) did not "
            "leave, as older ones still waited",
            "raise the baud rate or link.period_s, check the signal",
        ),
        NoticeTemplate(
            "link.undeliverable",
            "{count} of {total} messages to the vehicle ({percent:.1f} %, limit 1 %) were given "
            "back by the network",
            "check that the vehicle's address is reachable and its program runs",
        ),
        NoticeTemplate(
            "link.port_stuck",
            "{count} of {total} frames ({percent:.1f} %, limit 1 %) did not leave, as the "
            "module's port took nothing",
            "check the module's cable and supply",
        ),
        NoticeTemplate(
            "link.port_lost",
            "the module's port was lost {count}x",
            "check the module's cable and supply",
        ),
        NoticeTemplate(
            "link.bad_seal",
            "{count} datagrams to the radio bridge were sealed with another key and were ignored",
            "compare the keys of station and bridge; if they are the same, somebody forges "
            "datagrams",
        ),
        NoticeTemplate(
            "link.replayed_or_late",
            "{count} of {total} datagrams of the radio bridge ({percent:.1f} %, limit 1 %) came "
            "late or twice",
            "check the network between the two computers",
        ),
        NoticeTemplate(
            "link.other_session",
            "{count} datagrams of the radio bridge belonged to another session and were ignored",
            "see that only one station uses this bridge",
        ),
        NoticeTemplate("link.flown", "during the flight {says}"),
        NoticeTemplate(
            "tui.multiplexer",
            "{taker} takes some keys itself, as delivered Ctrl-A (screen) or Ctrl-B (tmux)",
            "where a key does nothing, press the second one, which the footer names",
        ),
        # Poses that do not respond to the commands (docs/explanation/trust.md).
        NoticeTemplate(
            "pose.attitude_no_answer",
            "the attitude of the poses does not respond to the commanded turns",
            "check the object's name, its axes (`groundstation carry`) and the latency of the "
            "tracker",
        ),
        NoticeTemplate(
            "pose.late",
            "the poses follow the commands 0.1 s or more later than configured, whatever their "
            "stamps say",
            "check the latency of the tracker and the link (`groundstation identify`), and the "
            "object's axes (`groundstation carry`)",
        ),
        NoticeTemplate(
            "pose.position_no_answer",
            "the position of the poses does not respond to the commanded motion, or something "
            "holds the vehicle",
            "check the object's name, its markers, and the unit of its positions",
        ),
        NoticeTemplate(
            "pose.position_mirrored",
            "the position moves against, or not with, the commanded accelerations",
            "check pose.world and pose.body with `groundstation carry`, and that nothing holds the "
            "vehicle",
        ),
        NoticeTemplate(
            "pose.stopped_dead",
            "the position stopped dead while the vehicle moved on, or something caught the vehicle",
            "check the tracker",
        ),
        NoticeTemplate(
            "pose.yaw_unasked",
            "the poses turn about the vertical by more than 9 deg/s beyond the commanded yaw rate",
            "check the object's markers",
        ),
        NoticeTemplate(
            "pose.height_behind",
            "the height just off the floor is less than the thrust explains",
            "check the object's name, the floor's height, and that nothing holds the vehicle",
        ),
        NoticeTemplate(
            "pose.autopilot_disagrees",
            "the attitude of the poses disagrees with the autopilot's own",
            "check that the tracked object is this vehicle, and its axes",
        ),
        # Guards: one sentence for each row of core/safety/guards.py.
        NoticeTemplate("guard.tilt", "tilt {tilt_deg:.0f}°, limit {limit_deg:g}°"),
        NoticeTemplate(
            "guard.oscillation",
            "oscillation: tilt {off_deg:.0f}° from the required one, limit {limit_deg:g}°",
            "check lags, delays and the latency of the poses (`groundstation identify`)",
        ),
        NoticeTemplate("guard.error", "{error_m:.2f} m from the reference, limit {limit_m:g} m"),
        NoticeTemplate(
            "guard.speed",
            "{speed_m_s:.1f} m/s relative to the reference velocity, limit {limit_m_s:g} m/s",
        ),
        NoticeTemplate(
            "guard.thrust",
            "thrust at its limit for {lasts_s:g} s",
            "check battery, load and vehicle.thrust_max_n",
        ),
        NoticeTemplate("guard.rate", "a body rate at its limit for {lasts_s:g} s of the last 2 s"),
        NoticeTemplate(
            "guard.weak",
            "thrust is {found:.0f} % of what is commanded, limit {limit:.0f} %",
            "check battery, propellers and vehicle.mass_kg",
        ),
        NoticeTemplate("guard.fence", "{outside_m:.2f} m outside the fence"),
        NoticeTemplate(
            "guard.braking", "{room_m:.2f} m before the fence at {speed_m_s:.1f} m/s", "braking"
        ),
        NoticeTemplate("guard.separation", "{distance_m:.2f} m from {name}, limit {limit_m:g} m"),
        NoticeTemplate(
            "guard.approach", "{distance_m:.2f} m from {name} and approaching", "braking"
        ),
        NoticeTemplate("guard.unseen", "no sighting of {names} for more than {limit_s:g} s"),
        NoticeTemplate(
            "guard.pose_age",
            "pose age {age_ms:.0f} ms on arrival, limit {limit_ms:.0f} ms",
            "check the tracker's network",
        ),
        NoticeTemplate(
            "guard.pose_resets",
            "{count} resets of the estimate behind the poses within 5 s, limit {limit}",
            "check the source of the poses",
        ),
        NoticeTemplate(
            "guard.under_floor", "poses {depth_m:.2f} m under the floor, limit {limit_m:g} m"
        ),
        NoticeTemplate(
            "guard.overruns",
            "{count} of the last 100 frames were late, limit {limit}",
            "this computer is too slow",
        ),
        NoticeTemplate(
            "guard.round_trip",
            "round trip {rtt_ms:.0f} ms, limit {limit_ms:.0f} ms",
            "check the radio",
        ),
        NoticeTemplate("guard.charge", "battery at {charge:.0f} %, limit {limit:.0f} %"),
        NoticeTemplate("guard.voltage", "battery at {voltage_v:.2f} V, limit {limit_v:.2f} V"),
    ),
)

NOTICES: dict[str, NoticeTemplate] = {
    template.id: template
    for table in (
        _TABLE,
        FLIGHT_NOTICES,
        PREFLIGHT_NOTICES,
        POSE_NOTICES,
        STATION_NOTICES,
        LAB_NOTICES,
        SCREEN_NOTICES,
        ANALYSIS_NOTICES,
        COMMAND_NOTICES,
        CONFIG_NOTICES,
        LINK_NOTICES,
    )
    for template in table
}
"""Every sentence by its id."""


def notice(id: str, **values: object) -> Sentence:
    """Return the sentence ``id`` of the table and its remedy, filled with ``values``.

    Raises:
        KeyError: the table has no such sentence, or the sentence names a value that is missing.
    """
    return NOTICES[id].format(**values)


def notice_fact(id: str, **values: object) -> Sentence:
    """Return the same without its remedy: where nothing is to be done, or not yet.

    Raises:
        KeyError: as of :func:`notice`.
    """
    return NOTICES[id].format_fact(**values)
