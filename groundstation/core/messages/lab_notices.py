"""Sentences of the commands before a flight: doctor, carry, props-off, check --watch. Sans-IO."""

from links.text import NoticeTemplate, as_warnings

LAB_NOTICES: tuple[NoticeTemplate, ...] = (
    # doctor: an autopilot's parameters.
    NoticeTemplate("doctor.healthy", "Nothing to change: {ok} ok, {note} to be read{absent}."),
    NoticeTemplate("doctor.set_to", "set it to {value}: {command} --fix {name}"),
    NoticeTemplate("doctor.reboot", "(counts after the autopilot was restarted)"),
    NoticeTemplate("doctor.fixed", "{name}: {old} became {new}, read back from the autopilot."),
    NoticeTemplate("doctor.undo", "To take it back: {command} --restore {path}"),
    NoticeTemplate(
        "doctor.confirm",
        "{autopilot} of {vehicle}: {name} is {old} and becomes {new}.\nType {name} to set it, "
        "anything else to stop: ",
    ),
    NoticeTemplate("doctor.unchanged", "{name} was not changed"),
    # carry: the moves of a carried vehicle.
    NoticeTemplate("carry.begin", "Propellers off. Nothing is commanded."),
    NoticeTemplate(
        "carry.begin_unseen",
        "Propellers off. This link does not report whether the vehicle is armed: see that it is "
        "not.",
    ),
    NoticeTemplate("carry.move", "{number} of {count}: {move}"),
    NoticeTemplate("carry.axes", "the lab's axes are '{world}', the body's are '{body}'"),
    NoticeTemplate(
        "carry.north", "the lab's north is {yaw_deg:+.1f}° to the right of where the nose was"
    ),
    NoticeTemplate(
        "carry.body_turned",
        "mounting offset of the tracked body: roll {roll_deg:+.1f}, pitch {pitch_deg:+.1f}, yaw "
        "{yaw_deg:+.1f}°",
    ),
    NoticeTemplate(
        "carry.autopilot_north", "the autopilot's north is {north_deg:.0f}° to the {side} of ours"
    ),
    NoticeTemplate(
        "carry.latency", "by the autopilot poses are {late_ms:.0f} ms {way} than they are stamped"
    ),
    NoticeTemplate(
        "carry.latency_unsynchronised",
        "by the autopilot poses are {late_ms:.0f} ms {way} than they are stamped, "
        "without the delay of its messages, as it does not send its time",
    ),
    NoticeTemplate("carry.written", "written into {path}; as it was before: {kept}"),
    NoticeTemplate("carry.interrupted", "interrupted, nothing is written"),
    # props-off: the test with the propellers off.
    NoticeTemplate(
        "props.begin",
        "THE MOTORS OF {vehicle} WILL START, several times. Its propellers must be OFF: take them "
        "off now.\nHold the vehicle down, keep fingers, hair and cables away, and have its "
        "battery plug and the remote control at hand.\nThrust is never more than idling. Ctrl-C "
        "at any time orders the motors off and ends the test.\n",
    ),
    NoticeTemplate(
        "props.confirm", "Propellers off? Type the vehicle's name, {vehicle}, to begin: "
    ),
    NoticeTemplate("props.not_begun", "Nothing was begun."),
    NoticeTemplate("props.step", "{number}/{count}  {name}"),
    NoticeTemplate("props.proven", "proven: {what}"),
    NoticeTemplate(
        "props.once_more",
        "The vehicle disarmed itself before the step was over, as one that does not take off does "
        "(COM_DISARM_PRFLT, DISARM_DELAY). Once more.",
    ),
    NoticeTemplate("props.arming", "Arming: THE MOTORS START."),
    NoticeTemplate("props.off", "Ordered off."),
    NoticeTemplate(
        "props.ask_turning", "Do all motors turn, slowly, and each the right way round?"
    ),
    NoticeTemplate(
        "props.ask_stopped_at_once",
        "They were ordered off, as Ctrl-\\ does. Did they stop at once?",
    ),
    NoticeTemplate("props.ask_stopped", "Did the motors stop?"),
    NoticeTemplate("props.ask_stayed_off", "Did they stay off?"),
    NoticeTemplate("props.ask_stopped_by_that", "Did they stop by that, and are they off?"),
    NoticeTemplate(
        "props.cover", "Cover the markers, or close the tracker, NOW. The motors must stop."
    ),
    NoticeTemplate(
        "props.uncover",
        "Uncover the markers, or open the tracker again, and press Enter: the motors must stay "
        "off. ",
    ),
    NoticeTemplate(
        "props.kill_soon",
        "In {after_s:g} s the program that flies is killed (SIGKILL). The motors must stop by "
        "themselves.",
    ),
    NoticeTemplate("props.killed", "It is killed."),
    NoticeTemplate(
        "props.pull",
        "Pull the plug between this program and the vehicle NOW: the network's, the telemetry "
        "radio's, or the module's. The motors must stop by themselves.",
    ),
    NoticeTemplate("props.noticed", "This program has noticed: {what}."),
    NoticeTemplate("props.plug_back", "Put the plug back, and press Enter. "),
    NoticeTemplate("props.switch", "Use the remote control's kill switch NOW."),
    NoticeTemplate(
        "props.press_enter",
        "{what} Press Enter as soon as the motors have stopped (within {limit_s:g} s). ",
    ),
    NoticeTemplate("props.by_eye", "stopped, by the operator's eye"),
    NoticeTemplate("props.acknowledged", "stopped, acknowledged {after_ms:.0f} ms after the order"),
    NoticeTemplate("props.silent", "nothing left {after_ms:.0f} ms after the last pose"),
    NoticeTemplate(
        "props.silent_disarmed",
        "nothing left {after_ms:.0f} ms after the last pose, the vehicle reported disarmed "
        "{disarmed_s:.1f} s after it",
    ),
    NoticeTemplate(
        "props.after_kill", "the motors stopped {after_s:.1f} s after it, by the operator's eye"
    ),
    NoticeTemplate(
        "props.after_notice",
        "the motors stopped {after_s:.1f} s after this program had noticed, by the operator's eye",
    ),
    NoticeTemplate(
        "props.within", "the motors stopped within {after_s:.1f} s, by the operator's eye"
    ),
    NoticeTemplate("props.interrupted", "Interrupted. Nothing was kept."),
    NoticeTemplate(
        "props.passed",
        "Passed. Kept in {path}, for this vehicle, configuration and firmware ({firmware}).",
    ),
    # check --watch: a stream of poses.
    NoticeTemplate("watch.title", "{kind} poses of {vehicle}: Ctrl-C ends"),
    NoticeTemplate(
        "watch.nothing",
        "nothing has come",
        "check the address in [pose], that the tracker streams to this machine, and the firewall",
    ),
    NoticeTemplate("watch.moving", "moves", "keep it at rest to measure"),
    NoticeTemplate("watch.no_pose", "no pose yet"),
    NoticeTemplate("watch.age", "{age_ms:.0f} ms"),
    NoticeTemplate(
        "watch.poses",
        "{count}, {rate_hz:.1f} per second arrive, {source_rate_hz:.1f} by their stamps",
    ),
    NoticeTemplate("watch.latency", "{latency_ms:.1f} ms, longest {most_ms:.1f} ms"),
    NoticeTemplate("watch.jitter", "{jitter_ms:.1f} ms, longest wait {longest_ms:.0f} ms"),
    NoticeTemplate("watch.gaps", "{gaps}; its clock stepped {steps} times"),
    NoticeTemplate(
        "watch.gaps_drift", "{gaps}; its clock stepped {steps} times, drift {drift_ppm:+.0f} ppm"
    ),
    NoticeTemplate(
        "watch.place", "north {north_m:+.3f}  east {east_m:+.3f}  height {height_m:+.3f} m"
    ),
    NoticeTemplate(
        "watch.attitude", "roll {roll_deg:+.1f}  pitch {pitch_deg:+.1f}  yaw {yaw_deg:+.1f}°"
    ),
    NoticeTemplate(
        "watch.noise",
        "{north_mm:.2f} {east_mm:.2f} {down_mm:.2f} mm  {roll_deg:.2f} {pitch_deg:.2f} "
        "{yaw_deg:.2f}°",
    ),
    *as_warnings(
        # doctor
        NoticeTemplate(
            "doctor.changes", "{must} must and {should} should be changed; {ok} ok{absent}."
        ),
        NoticeTemplate(
            "doctor.unknown_autopilot",
            "this is no PX4 and no ArduPilot ({kind}): nothing is known about it",
        ),
        NoticeTemplate(
            "doctor.no_parameters",
            "the autopilot sends but reports none of its parameters",
            "check that our messages arrive",
        ),
        NoticeTemplate(
            "doctor.armed",
            "the vehicle is armed: parameters are changed only while its motors are off",
        ),
        NoticeTemplate(
            "doctor.not_read_back",
            "{name} was set but can't be read back",
            "read it again before you fly",
        ),
        NoticeTemplate("doctor.reads_back", "{name} was set to {value} but reads back as {found}"),
        NoticeTemplate(
            "doctor.no_heartbeat",
            "no HEARTBEAT within {limit_s:g} s, so it is unknown whether the autopilot is armed",
        ),
        NoticeTemplate("doctor.other_file", "{path} is no file that --fix has written: {why}"),
        NoticeTemplate(
            "doctor.link_kind",
            "expected mavlink, dsm or crsf: by the map there its settings are judged",
        ),
        NoticeTemplate(
            "doctor.board_missing",
            "expected the flight controller's own port, /dev/serial/by-id/… or HOST:PORT",
        ),
        NoticeTemplate(
            "doctor.board_idle",
            "is for a flight controller behind a receiver: over MAVLink it is asked there",
        ),
        NoticeTemplate(
            "doctor.full_rate",
            "link.map.{axis}.full_rate_deg_s: Betaflight knows whole tens up to 1990, got "
            "{rate_deg_s:g}",
        ),
        NoticeTemplate(
            "doctor.arm_channel",
            "link.map.arm: Betaflight arms by a channel from 5 on, expected one",
        ),
        NoticeTemplate(
            "doctor.yes_alone", "it needs the one parameter that it confirms: --fix NAME"
        ),
        NoticeTemplate("doctor.restore_alone", "it puts one parameter back: leave out --fix"),
        NoticeTemplate("doctor.no_terminal", "without a terminal, confirm with --yes"),
        NoticeTemplate("doctor.twice", "{name} is named twice: say once what it should be"),
        NoticeTemplate("doctor.absent", "this {autopilot} has no parameter {name}"),
        NoticeTemplate(
            "doctor.other_kind", "this {autopilot} has no parameter {name} of that kind"
        ),
        NoticeTemplate("doctor.no_number", "{name}: expected a number, got {text!r}"),
        NoticeTemplate("doctor.not_accepted", "{name}: expected {accepted}, got {value}"),
        NoticeTemplate(
            "doctor.fine", "{name} is {value}, which is fine; to change it anyway say {name}=VALUE"
        ),
        NoticeTemplate(
            "doctor.other_vehicle",
            "the file is of {autopilot}, system {system}; this is {found}, system {found_system}",
        ),
        # carry
        NoticeTemplate("carry.not_recorded", "the moves can't be recorded: {why}"),
        NoticeTemplate("carry.not_found", "NOT FOUND: {why}"),
        NoticeTemplate(
            "carry.source", "expected a tracking system that runs: other poses have no axes to find"
        ),
        NoticeTemplate(
            "carry.overrides",
            "with overrides nothing can be written into the file: add --dry-run, or leave them out",
        ),
        NoticeTemplate(
            "carry.armed",
            "the vehicle is ARMED: disarm it, take its propellers off, and begin anew",
        ),
        NoticeTemplate(
            "carry.unheard", "the autopilot is {state}, so it is unknown whether it is armed: {why}"
        ),
        NoticeTemplate(
            "carry.not_made",
            "'{move}' was not made within {limit_s:.0f} s{seen}. See check --watch",
        ),
        NoticeTemplate(
            "carry.lab_askew",
            "the lab's axes are tilted by {angle_deg:.0f}°: is the vehicle level on the floor?",
        ),
        NoticeTemplate(
            "carry.body_askew",
            "the tracked body has a mounting offset of {angle_deg:.0f}°",
            "turn its axes along the vehicle's in the tracker's program, or connect the "
            "autopilot, which can measure it",
        ),
        NoticeTemplate(
            "carry.attitude_stopped",
            "the autopilot's attitude has stopped meanwhile",
            "look at the link, and begin anew",
        ),
        NoticeTemplate(
            "carry.misfit",
            "'{move}' does not fit the other turns, by {angle_deg:.0f}°",
            "make the moves as they are shown",
        ),
        NoticeTemplate(
            "carry.turned_otherwise", "'{move}': the autopilot measured it {way} instead"
        ),
        NoticeTemplate(
            "carry.turned_apart",
            "'{move}': the tracker measured a turn of {seen_deg:.0f}°, the autopilot "
            "{felt_deg:.0f}°",
            "does the tracker follow this vehicle, and does its body keep its markers?",
        ),
        NoticeTemplate(
            "carry.left_handed",
            "the tracker's axes are left-handed: its places are the mirror image of its turns. "
            "Choose right-handed axes in its program; no setting here can mend that",
        ),
        NoticeTemplate(
            "carry.went_otherwise",
            "'{move}': by the turns it went {way} instead. Make the moves as they are shown; "
            "where they were, the tracker mixes two frames",
        ),
        NoticeTemplate(
            "carry.by_hand",
            "is written in a way that can't be changed here; put this into it: {keys}",
        ),
        NoticeTemplate("carry.unwritable", "can't be written ({why}); put this into it: {keys}"),
        # props-off
        NoticeTemplate(
            "props.terminal",
            "motors will turn: it needs somebody at a terminal, and can't be scripted",
        ),
        NoticeTemplate(
            "props.not_proven", "NOT PROVEN: {why}. Do not fly before this test is passed."
        ),
        NoticeTemplate("props.stopped", "The test can't go on: {why}. Nothing was kept."),
        NoticeTemplate("props.unwritable", "passed, but {path} can't be written: {why}"),
        NoticeTemplate(
            "props.disarms_itself",
            "the vehicle disarmed itself {count} times before the step was over: allow it more "
            "time",
        ),
        NoticeTemplate("props.unacknowledged", "nobody acknowledged the order to stop the motors"),
        NoticeTemplate("props.not_armed", "not armed within {limit_s:g} s"),
        NoticeTemplate(
            "props.may_be_armed",
            "THE VEHICLE MAY STILL BE ARMED: nobody acknowledged the order to disarm ({why}). "
            "Stop it by the remote control, or by its battery plug, before you touch it.",
        ),
        NoticeTemplate("props.poses_come", "poses still come"),
        NoticeTemplate("props.unnoticed", "this program noticed nothing: was it the right plug?"),
        NoticeTemplate(
            "props.still_turning",
            "the motors still turned {limit_s:g} s later: see `groundstation doctor`",
        ),
        NoticeTemplate("props.not_confirmed", "“{question}” was not answered with y"),
        NoticeTemplate(
            "props.hand_ended", "the program that holds the vehicle has ended by itself"
        ),
        NoticeTemplate(
            "props.armed_already", "its motors are on already: somebody else has armed it"
        ),
        NoticeTemplate("props.no_pose", "no pose within {limit_s:g} s"),
    ),
)
