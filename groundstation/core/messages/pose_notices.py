"""Sentences of pose sources: why poses are dropped, and what happens to those that pass. Sans-IO.

A row ``drop.REASON`` belongs to each reason that sources and the gate count and that has a cause to
name.
"""

from links.text import NoticeTemplate, as_warnings

_DROPS = {
    "not_live": "Motive is in edit mode or plays a recording: go to Live",
    "wrong_version": "the bit stream is too old: Motive's streaming settings, bit stream version, "
    "3.0 or later",
    "wrong_layout": "a bit stream that is not known here: Motive's streaming settings, bit stream "
    "version, 4.1",
    "failed": "the sender says that its odometry has failed (ODOMETRY.quality below 0): restart "
    "its estimator",
    "not_tracked": "the tracker does not find the body: look for markers that are hidden, lost or "
    "have moved",
    "frozen": "the same to the last bit: look for hidden markers; where the tracker rounds, "
    "pose.drop_frozen = false",
    "no_such_body": "the stream does not hold the vehicle's body: is its name right, has it been "
    "switched off? `groundstation check --watch` lists the names",
    "no_such_object": "the stream does not hold the vehicle's object: is its name right, has it "
    "been switched off? `groundstation check --watch` lists the names",
    "same_name": "several bodies have the vehicle's name or streaming id: give each one of its own",
    "jump": "further from the last one than it can have flown (gate.jump_m): markers mixed up, "
    "another body, or another unit than the source's; see the tracker's program",
    "spin": "turned faster than it can have (gate.rate_deg_s): markers mixed up; see the tracker's "
    "program",
    "too_fast": "faster than the vehicle can be (gate.speed_m_s): is the position in metres?",
    "tilted": "on its back (gate.tilt_deg): are pose.world and pose.body right?",
    "not_finite": "NaN or infinity in it: see what the sender computes, or whether the body is "
    "hidden",
    "not_unit": "its quaternion has not length 1, or its matrix is no rotation: correct the sender",
    "absurd": "numbers that no room holds: is each in the unit that this source expects?",
    "absurd_stamp": "its time stamp is no time: is it in the wrong unit?",
    "same_stamp": "the sender does not set its time stamp, or several poses have the same one: "
    "have it stamp each pose anew",
    "out_of_order": "older than one before: was the sender's clock set back, or is more than one "
    "on this address?",
    "duplicate": "sent twice: is more than one sender on this address?",
    "other_address": "somebody else sends to this address: end the program that should not",
    "second_sender": "a second program or computer sends poses of the vehicle to the same port: "
    "end the one that should not",
    "late": "older on arrival than flight.coast_s allows",
    "truncated": "its end is missing: a bridge or network cuts datagrams, or loses a part of one; "
    "or something else sends to this port",
    "oversized": "longer than the protocol allows: does something else send to this port?",
    "garbage": "bytes that are not of this protocol: does something else send to this port?",
    "malformed": "not of this protocol: does something else send to this port?",
    "wrong_item": "not of this protocol: does something else send to this port?",
    "not_json": "no JSON: does something else send to this port?",
    "wrong_schema": "JSON without the fields of a pose: compare with docs/how-to/extend.md",
    "bad_crc": "a wrong checksum: bytes were lost or changed on the way: check cable, "
    "radio and speed of the port",
    "wrong_frame": "in a frame of coordinates that is not read here: send LOCAL_NED or LOCAL_FRD",
    "no_attitude": "no attitude came with the position: have the autopilot send "
    "ATTITUDE_QUATERNION",
    "no_stamp": "no time stamp in it: have the sender set it",
    "no_exposure_stamp": "no time of exposure in it, as in a recording that is played back: go to "
    "Live",
    "no_bodies": "no rigid bodies in it: stream 6DOF",
    "no_data": "QTM says that it has no data: start a measurement or a preview",
    "other_bodies": "more or fewer bodies than QTM names, whose names are asked for anew: has the "
    "project changed, or is a body switched off in it?",
    "other_message": "a MAVLink message that holds no pose",
    "other_system": "of another MAVLink system: is pose.system_id right?",
    "other_component": "of another MAVLink component: is pose.component_id right?",
    "unknown": "a MAVLink message that is not known here",
    "unknown_message": "a NatNet message that is not known here: does something else send to this "
    "port?",
    "no_server_info": "the NatNet server has not described itself yet: does it reply at "
    "pose.server?",
    "child_lost": "the program that reads the tracker has ended; it is started again",
    "connection_lost": "the tracker has closed the connection; it is opened again",
}
"""Causes and remedies by reason."""
_MEASURED_DROPS = {
    "jump": "{value:.2f} m from where the last ones were heading, limit {limit:.2f} m (gate.jump_m "
    "and gate.acceleration_m_s2): markers mixed up, another body, or another unit than the "
    "source's; see the tracker's program",
    "spin": "turned by {value:.0f}° since the last one, limit {limit:.0f}° (gate.rate_deg_s): "
    "markers mixed up; see the tracker's program",
    "too_fast": "{value:.1f} m/s, limit {limit:g} m/s (gate.speed_m_s): is the position in metres?",
    "tilted": "{value:.0f}° from upright, limit {limit:g}° (gate.tilt_deg): where it stands or "
    "flies upright, pose.body or pose.world names the axes wrongly (`groundstation carry` finds "
    "them); a vehicle that loops needs 180",
    "frozen": "the same to the last bit for {value:.2f} s, limit {limit:g} s (gate.frozen_s): "
    "look for hidden markers; where the tracker rounds, gate.drop_frozen = false",
    "late": "{value:.0f} ms old when it came, limit {limit:.0f} ms (flight.coast_s): look for a "
    "queue in the network or the tracking computer, or a pose.rate_hz above the cameras' rate",
}
"""Sentences of those reasons for which the newest drop has a number and a limit."""

POSE_NOTICES: tuple[NoticeTemplate, ...] = (
    *(
        NoticeTemplate(f"drop.{reason}", f"{reason} ({meaning})")
        for reason, meaning in _DROPS.items()
    ),
    *(
        NoticeTemplate(f"drop.{reason}.by", f"{reason} ({meaning})")
        for reason, meaning in _MEASURED_DROPS.items()
    ),
    NoticeTemplate("drop.other", "{reason}"),
    NoticeTemplate("pose.origin_moved", "the source has moved its origin, or was started anew"),
    NoticeTemplate("pose.agreed", "all poses have agreed on it for {settle_s:g} s"),
    NoticeTemplate(
        "pose.elsewhere", "poses are {far_m:.2f} m and {turn_deg:.0f}° from before: {why}"
    ),
    NoticeTemplate(
        "qualisys.no_plain_xml", "the parameters are longer than QTM's, or are no plain XML"
    ),
    NoticeTemplate("qualisys.no_xml", "the parameters are no XML: {why}"),
    NoticeTemplate("pose.made_up", "mock makes bodies up: they never fly a vehicle"),
    NoticeTemplate(
        "pose.no_link", "'mavlink' needs link.kind = 'mavlink'", "no other link brings poses"
    ),
    NoticeTemplate("pose.passed", "{reason} is over: {count} dropped within {lasted_s:.2f} s"),
    NoticeTemplate(
        "pose.later",
        "poses are {late_ms:.0f} ms later than before",
        "they are delayed (network, tracking computer); or the tracker's clock was set back, its "
        "frame counter paused or its rate changed, which looks the same. If they are not that "
        "old: on the ground, stop the tracker's stream for 5 s, or start this program anew",
    ),
    NoticeTemplate("pose.punctual", "poses are as early as before, or their source has restarted"),
    NoticeTemplate(
        "pose.cannot_listen", "cannot listen for {what} on {address} ({why})", "{advice}"
    ),
    NoticeTemplate(
        "libmotioncapture.silent",
        "the {backend} server at {hostname} does not answer",
        "check its address, and that it streams",
    ),
    NoticeTemplate(
        "qualisys.unreachable",
        "cannot reach QTM at {server} ({why})",
        "check that it runs, the address, and that its RT output is on (little-endian port, "
        "mostly 22223)",
    ),
    NoticeTemplate("qualisys.no_version", "QTM did not speak version {version} of its protocol"),
    NoticeTemplate("qualisys.silent_bodies", "QTM did not report its 6DOF bodies"),
    NoticeTemplate(
        "qualisys.silent_stream", "QTM did not stream", "is a measurement or a preview running?"
    ),
    NoticeTemplate("qualisys.refused_bodies", "QTM refused to report its 6DOF bodies: {why}"),
    NoticeTemplate(
        "qualisys.refused_stream",
        "QTM refused to stream: {why}",
        "is a measurement or a preview running?",
    ),
    NoticeTemplate("qualisys.bodies", "QTM at {server} does not report its bodies: {why}"),
    *as_warnings(
        NoticeTemplate(
            "pose.lost",
            "poses are lost: none for {age_ms:.0f} ms, limit {limit_ms:.0f} ms (flight.coast_s)",
            "check the tracker and its network",
        ),
    ),
    NoticeTemplate("pose.back", "poses are back after {gap_s:.2f} s"),
)
