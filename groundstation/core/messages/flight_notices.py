"""Sentences of a flight: mission, take-off, link in flight, shutdown, gains. Sans-IO."""

from links.text import NoticeTemplate, as_warnings

FLIGHT_NOTICES: tuple[NoticeTemplate, ...] = (
    # States of the mission.
    NoticeTemplate("mission.waiting", "waiting for the link and for poses"),
    NoticeTemplate(
        "mission.ready",
        "link and poses are available; poses at {rate_hz:.0f} Hz, latency {latency_ms:.0f} ms",
    ),
    NoticeTemplate("mission.arming", "requesting offboard control and arming from the autopilot"),
    NoticeTemplate("mission.spooling", "spooling up until lift-off"),
    NoticeTemplate("mission.following", "following the trajectory"),
    NoticeTemplate("mission.off_floor", "off the floor: climbing"),
    NoticeTemplate("mission.at_height", "at height: holding"),
    NoticeTemplate(
        "mission.hovers",
        "it hovers at {hover_n:.4g} N, {percent:.0f} % of its weight: onto the trajectory",
    ),
    NoticeTemplate("mission.flown", "trajectory flown for {duration_s:g} s"),
    NoticeTemplate("mission.to_point", "to {target}"),
    NoticeTemplate("mission.goto", "to {target}: {why}"),
    NoticeTemplate("mission.not_to_point", "not to {target}: {why}"),
    NoticeTemplate("mission.there", "there: {target}"),
    NoticeTemplate("mission.home", "over the place of take-off"),
    NoticeTemplate("mission.touched_down", "touched down"),
    NoticeTemplate("mission.still_on_floor", "still on the floor"),
    NoticeTemplate("mission.disarmed", "landed and disarmed"),
    NoticeTemplate(
        "mission.forced_off",
        "landed; the autopilot refused to disarm, so its motors were stopped by force",
    ),
    NoticeTemplate("mission.felt_floor", "the autopilot has detected touchdown and disarmed"),
    NoticeTemplate("mission.asked", "{why}"),
    NoticeTemplate("mission.ended_before", "ended before take-off: {why}"),
    NoticeTemplate("mission.killed", "motors off: {why}"),
    NoticeTemplate("mission.not_possible", "{ask} is not possible while {state}"),
    NoticeTemplate(
        "mission.over",
        "{ask} is not possible after the end of a flight ({state})",
        "a daemon gets ready for the next one by itself; otherwise run `groundstation fly` again",
    ),
    NoticeTemplate(
        "mission.hold_first", "{ask} is not possible while {state}", "request hold first"
    ),
    NoticeTemplate("mission.refused_asker", "{refusal} ({why})"),
    NoticeTemplate("mission.goto_refused", "goto is refused: {why}"),
    # Points and ways that are refused.
    NoticeTemplate(
        "goto.target",
        "north {north_m:.2f}, east {east_m:.2f}, {height_m:.2f} m above the floor{which}",
    ),
    NoticeTemplate("goto.point", "point {number} of {count}, {place}, {why}"),
    NoticeTemplate("goto.way", "to {target}: {why}"),
    NoticeTemplate(
        "goto.height",
        "is {height_m:.2f} m {side} the floor: it must be at least {limit_m:g} m above it",
    ),
    NoticeTemplate("goto.outside", "is {outside_m:.2f} m outside the fence"),
    NoticeTemplate("goto.unseen", "no sighting of {names}"),
    NoticeTemplate("goto.braking", "on the way the vehicle could not brake within the fence"),
    NoticeTemplate(
        "goto.speed",
        "faster than limits.max_speed_m_s ({limit_m_s:g})",
        "lower takeoff.transit_m_s",
    ),
    NoticeTemplate("goto.near", "on the way the vehicle would come too near to {name}"),
    # Why a flight ends early.
    NoticeTemplate("fault.not_confirmed", "not armed: the operator did not confirm"),
    # Reports beside the states.
    NoticeTemplate(
        "flight.taken", "the autopilot is in {mode}, not set by us: nothing is sent any more"
    ),
    NoticeTemplate("flight.bring_down_over", "the bring-down is over: nothing is sent any more"),
    NoticeTemplate("flight.motors_off", "motors off, acknowledged by the vehicle"),
    NoticeTemplate(
        "flight.poses_go_on",
        "poses go on to the autopilot, and it can be killed from here until its motors stop; a "
        "second Ctrl-C ends that too",
    ),
    NoticeTemplate(
        "flight.still_heard",
        "the vehicle still sends, and it can be killed from here until its motors stop; a second "
        "Ctrl-C ends that too",
    ),
    NoticeTemplate("flight.left_as_asked", "nothing is sent to the vehicle any more, as requested"),
    NoticeTemplate(
        "flight.left_stopped",
        "nothing is sent to the vehicle any more: its motors have stopped, or it sends no more",
    ),
    NoticeTemplate("flight.over", "{state}: the flight is over, and nothing is sent any more"),
    NoticeTemplate(
        "flight.autopilot_lands",
        "the autopilot brings the vehicle down: request kill, or descend to leave it alone",
    ),
    NoticeTemplate("flight.state", "{state}: {reason}"),
    NoticeTemplate("flight.arms", "arming"),
    # Gains that are changed in flight.
    NoticeTemplate(
        "gain.none", "only the adaptive controller has gains that can be changed in flight"
    ),
    NoticeTemplate("gain.unknown", "{key} can't be changed in flight: expected one of {keys}"),
    NoticeTemplate("gain.invalid", "{key}: {why}"),
    NoticeTemplate(
        "gain.step",
        "{key} is {now:g}: one change goes to {low:g} at least and {high:g} at most, got {value:g}",
    ),
    NoticeTemplate("gain.back", "{key} goes back to {value:g}"),
    NoticeTemplate(
        "gain.busy",
        "{key}: the last change is still being compared; only that one can be reverted now",
    ),
    NoticeTemplate(
        "gain.too_early",
        "{key}: a change is compared with the {before_s:g} s before it: hold or track for that "
        "long first",
    ),
    NoticeTemplate("gain.moves", "{key} goes from {now:g} to {value:g} within {ramp_s:g} s"),
    NoticeTemplate(
        "gain.unproven",
        "{key} goes back to {value:g}: the phase ended before the change was proven",
    ),
    NoticeTemplate("gain.several", "{says}"),
    NoticeTemplate("gain.stays", "{key} stays at {value:g}: the flight is as good as before"),
    *as_warnings(
        # States of the mission.
        NoticeTemplate(
            "mission.hover_thrust",
            "it hovers at {hover_n:.4g} N, {percent:.0f} % of its weight; vehicle.hover_range "
            "allows {low:.0f} to {high:.0f} %",
            "check mass_kg, thrust_max_n, battery and propellers",
        ),
        NoticeTemplate("fault.link", "{why}"),
        NoticeTemplate("fault.source", "{why}"),
        # Why a flight ends early.
        NoticeTemplate("fault.stopped", "stopped by {name}: {text}"),
        NoticeTemplate("fault.preflight", "pre-flight checks failed: {failed}"),
        NoticeTemplate("fault.not_armed", "not armed: {failed}"),
        NoticeTemplate("fault.no_first_pose", "no pose within {wait_s:g} s: {why}"),
        NoticeTemplate(
            "fault.not_in_air",
            "flight.start is air, but the poses show the vehicle on its floor",
            "start `groundstation-sim serve` anew, or take off: --set flight.start=floor",
        ),
        NoticeTemplate(
            "fault.controller_hangs",
            "the controller hangs: the link has brought the vehicle down without it",
        ),
        NoticeTemplate(
            "fault.late_command",
            "the link takes no newer command, and plays its bring-down: {text}",
        ),
        NoticeTemplate(
            "fault.stood_still",
            "no command for {gap_ms:.0f} ms, as this program stood still: the link plays its "
            "bring-down",
        ),
        NoticeTemplate(
            "fault.no_pose",
            "no pose for {age_ms:.0f} ms, so the link plays its bring-down",
            "check the tracker and its network",
        ),
        NoticeTemplate(
            "fault.pose_gap",
            "no pose for {age_ms:.0f} ms",
            "check the tracker, its network, and whether this program stood still",
        ),
        NoticeTemplate(
            "fault.slept", "the sending computer slept for {slept_s:.1f} s: arm again to fly"
        ),
        NoticeTemplate("fault.link_lost", "commands have stopped{last}: {text}"),
        NoticeTemplate(
            "fault.link_lost_land", "the link is lost{last}: landing, as commands may still arrive"
        ),
        NoticeTemplate(
            "fault.disarmed",
            "the link is {state}, and the vehicle is disarmed: commands have stopped. {text}",
        ),
        NoticeTemplate(
            "fault.will_not_disarm",
            "landed at zero thrust, but the autopilot refuses to disarm: {why}",
        ),
        NoticeTemplate(
            "fault.motors_unknown",
            "landed at zero thrust, but the state of the motors is unknown: {why}",
        ),
        NoticeTemplate("fault.poses_land", "{reason}: landing, as they still respond"),
        NoticeTemplate("fault.poses_descend", "{reason}: down by {whose}"),
        NoticeTemplate("fault.poses_model", "{reason}: down on the model"),
        NoticeTemplate(
            "fault.poses_autopilot", "{reason}: the autopilot lands by its own position"
        ),
        NoticeTemplate(
            "fault.poses_floor", "{reason}: motors off, as the way down cannot take longer"
        ),
        NoticeTemplate(
            "fault.no_floor",
            "the descent takes too long, and no touchdown was detected (check flight.floor_z_m)",
        ),
        NoticeTemplate("fault.no_floor_end", "{why}: commands end"),
        NoticeTemplate(
            "fault.taken",
            "the autopilot is in {mode}, not set by us: nothing is sent from here any more",
        ),
        NoticeTemplate(
            "fault.late_commands",
            "commands reach the autopilot {late_ms:.0f} ms too late to fly by",
        ),
        NoticeTemplate("fault.late_commands_end", "{why}, so they end"),
        NoticeTemplate(
            "fault.unanswered",
            "commands do not reach the autopilot: it sends, but has not acknowledged for "
            "{overdue_ms:.0f} ms. It acts by its own failsafe for set-points that stop; if "
            "commands arrive again, it is brought down",
        ),
        # On the floor, as the motors spool up.
        NoticeTemplate("takeoff.no_pose", "no pose for {age_ms:.0f} ms while the motors spool up"),
        NoticeTemplate(
            "takeoff.fence", "{outside_m:.2f} m outside the fence while the motors spool up"
        ),
        NoticeTemplate(
            "takeoff.leaps",
            "position jumps sideways by {step_m:.2f} m from one pose to the next",
            "look at what holds or pushes it, and at its poses",
        ),
        NoticeTemplate(
            "takeoff.tips",
            "the vehicle tips: {tilt_deg:.0f}° from its attitude at rest, limit {limit_deg:g}°",
            "check propellers and motors, what holds or pushes it, and its poses",
        ),
        NoticeTemplate(
            "takeoff.slides",
            "the vehicle slides on the floor: {aside_m:.2f} m, limit {limit_m:.2f} m",
            "look at what holds or pushes it, and at its poses",
        ),
        NoticeTemplate(
            "takeoff.jumps",
            "the height jumps as no thrust explains",
            "look at its poses, and at what lifts it",
        ),
        NoticeTemplate(
            "takeoff.too_light",
            "the vehicle leaves the floor by {percent:.0f} % of its configured weight, or less",
            "correct vehicle.mass_kg, vehicle.hover_thrust or vehicle.thrust_max_n: it is lighter, "
            "or has more thrust, than they say, or it stands on a soft floor",
        ),
        NoticeTemplate(
            "takeoff.no_motion",
            "no lift-off: is this the right body, is the mass right? Thrust went to "
            "{thrust_n:.3g} N, {percent:.0f} % of the configured weight, and the newest pose, "
            "{age_ms:.0f} ms old, shows no motion",
            "check the object's name, the unit of its positions, vehicle.mass_kg, battery and "
            "propellers, that nothing holds the vehicle, and behind a radio that link.map.arm "
            "starts the motors; one that needs more thrust needs a larger takeoff.thrust_limit",
        ),
        NoticeTemplate(
            "takeoff.stuck",
            "no lift-off: the vehicle began to move and did not leave the floor",
            "check that nothing holds the vehicle",
        ),
        # Reports beside the states.
        NoticeTemplate("flight.preflight", "pre-flight {verdict}: {check}: {says}"),
        NoticeTemplate(
            "flight.bringing_down", "bringing down: the link levels, sinks and stops by itself"
        ),
        NoticeTemplate("flight.not_brought_down", "NOT brought down from here: {why}"),
        NoticeTemplate("flight.kill_unheard", "NOT acknowledged: {why}"),
        NoticeTemplate(
            "flight.left_turning",
            "nothing goes to the vehicle any more: its motors still turn after {limit_s:g} s, so "
            "use the remote control's kill switch",
        ),
        NoticeTemplate("link.warns", "{says}"),
        # V against its bound, and the thrust against its limits.
        NoticeTemplate(
            "certificate.no_proof", "Lyapunov: {bound}; only a lasting rise of V is reported"
        ),
        NoticeTemplate(
            "certificate.above",
            "Lyapunov: V has been above its bound for {for_s:.1f} s; largest term: {largest}",
        ),
        NoticeTemplate(
            "certificate.suspended",
            "Lyapunov: the bound is suspended most of the time, with commands at their limit; "
            "largest other term: {largest}",
        ),
        NoticeTemplate(
            "certificate.disturbance",
            "Lyapunov: the disturbance estimate has been above controller.b_bound for {for_s:.1f} "
            "s: {found_m_s2:.1f} m/s², limit {limit_m_s2:g} m/s²",
            "check mass, thrust and wind: they differ from the configuration by more than the "
            "bound covers",
        ),
        NoticeTemplate(
            "certificate.thrust_margin",
            "thrust margin: the command has been at its {which} limit, {thrust_n:.2f} N, for "
            "{for_s:.1f} s; the Lyapunov bound is suspended",
        ),
        # Total latency, by the vehicle's own answer and attitude.
        NoticeTemplate(
            "latency.total",
            "poses or the vehicle's turns are {late} than configured, by the response to the "
            "commands",
            "measure both (groundstation identify)",
        ),
        NoticeTemplate(
            "latency.vehicle",
            "the vehicle turns {late} than configured",
            "measure the lag and delay of its rates (groundstation identify)",
        ),
        NoticeTemplate(
            "latency.poses",
            "poses are {late} than configured, by the vehicle's own attitude",
            "measure their latency",
        ),
        # Gains that are changed in flight.
        NoticeTemplate(
            "gain.worse",
            "{key} goes back to {value:g}: {worse} has risen by more than a factor of {factor:g}",
        ),
    ),
)
