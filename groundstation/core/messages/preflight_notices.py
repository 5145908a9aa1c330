"""Sentences of the pre-flight checks, and of what keeps a flight from its start. Sans-IO.

A remedy belongs to the checks that warn or fail; one that passes says the fact alone.
"""

from links.text import NoticeTemplate

PREFLIGHT_NOTICES: tuple[NoticeTemplate, ...] = (
    NoticeTemplate("check.connection", "{why}"),
    # Poses.
    NoticeTemplate("check.pose_rate", "{rate_hz:.0f} poses a second{nominal}"),
    NoticeTemplate(
        "check.pose_rate_low",
        "{rate_hz:.0f} poses a second{nominal}: at least {limit_hz:g} are needed",
        "set a higher rate in the tracker, or mend what drops them",
    ),
    NoticeTemplate("check.pose_age", "the newest pose is {age_ms:.0f} ms old"),
    NoticeTemplate("check.pose_age_why", "the newest pose is {age_ms:.0f} ms old; {why}"),
    NoticeTemplate(
        "check.deadline",
        "a pose is used for {coast_ms:.0f} ms (flight.coast_s), in a descent for {level_ms:.0f} "
        "ms more (guards.level_s); then the bring-down",
    ),
    NoticeTemplate(
        "check.deadline_long",
        "a pose is used for {coast_ms:.0f} ms (flight.coast_s), in a descent for {level_ms:.0f} "
        "ms more (guards.level_s); then the bring-down. Together they are {usual_ms:.0f} ms by "
        "default",
    ),
    NoticeTemplate(
        "check.pose_noise",
        "noise of {noise_mm:.2f} mm on each axis, {noise_deg:.2f}° of roll and pitch",
        "calibrate the volume, and have more cameras see the body; with more of it flights end",
    ),
    NoticeTemplate(
        "check.far",
        "the poses are {away_m:.0f} m from the tracker's origin, limit {limit_m:g} m",
        "have the sender give positions in metres, and the volume its origin within the room",
    ),
    NoticeTemplate(
        "check.at_rest", "poses are within {spread_cm:.1f} cm", "the vehicle must be at rest"
    ),
    NoticeTemplate(
        "check.tilt",
        "tilted by {tilt_deg:.1f}° at rest",
        "level the floor, or correct the object's axes in the capture system",
    ),
    NoticeTemplate(
        "check.floor",
        "position {down_m:+.2f} m (down) at rest, flight.floor_z_m is {floor_m:+.2f} m",
        "a wrong one makes a wrong bring-down; correct it",
    ),
    NoticeTemplate("check.floor_air", "a simulated vehicle is held in the air (flight.start)"),
    NoticeTemplate("pose.most_dropped", "{count} were dropped: {why}"),
    NoticeTemplate("pose.advice", "{says}"),
    NoticeTemplate("pose.check_source", "check the source"),
    NoticeTemplate("pose.nothing_arrived", "nothing arrived at all; check address and port"),
    NoticeTemplate("pose.nothing_of_use", "nothing of use from pose.kind = {kind} ({keys}); {why}"),
    NoticeTemplate(
        "pose.no_estimate",
        "the autopilot sends but has no estimate of its position yet (pose.kind = mavlink). After "
        "a start that takes it some 40 s, and it needs GPS or an external pose: wait for it, then "
        "try again{said}",
    ),
    # The autopilot's attitude beside that of the poses.
    NoticeTemplate("check.witness_own", "there is none: the poses are the autopilot's own"),
    NoticeTemplate(
        "check.witness_radio",
        "there is none: this radio does not report the vehicle's attitude 10 times a second, as "
        "CRSF's may",
    ),
    NoticeTemplate(
        "check.witness_silent",
        "no attitude of the autopilot has poses beside it, so nothing checks the poses' attitude",
        "have it send ATTITUDE_QUATERNION, and look for gaps in the poses",
    ),
    NoticeTemplate(
        "check.witness_unlike",
        "moved by hand, {axes} turned another way in the poses than in the autopilot",
        "is it the right body? `groundstation carry` finds the axes of its object{sign}",
    ),
    NoticeTemplate(
        "check.witness_askew",
        "tilt by the poses and by the autopilot is {askew_deg:.1f}° apart",
        "is it the right body? `groundstation carry` finds the axes of its object, level the "
        "autopilot's accelerometers",
    ),
    NoticeTemplate(
        "check.witness_carried",
        "the motion of the poses differs from the autopilot's",
        "is the vehicle being carried?",
    ),
    NoticeTemplate(
        "check.witness", "tilt by the poses and by the autopilot is {askew_deg:.1f}° apart{alike}"
    ),
    # Fence, other vehicles, trajectory.
    NoticeTemplate("check.fence_none", "there is none"),
    NoticeTemplate("check.fence_outside", "{outside_m:.2f} m outside the fence"),
    NoticeTemplate("check.fence_inside", "{inside_m:.2f} m inside the fence"),
    NoticeTemplate("check.others_none", "separation.others names none"),
    NoticeTemplate(
        "check.others_near",
        "{distance_m:.2f} m from {name}, limit {limit_m:g} m",
        "move one of them",
    ),
    NoticeTemplate(
        "check.others_unseen",
        "no sighting of {names}",
        "uncover them, or take them out of separation.others",
    ),
    NoticeTemplate("check.others", "{name} is nearest, {distance_m:.2f} m away"),
    NoticeTemplate("check.ways_none", "there is no fence"),
    NoticeTemplate("check.ways_short", "the {where}: the vehicle could not brake within the fence"),
    NoticeTemplate("check.ways", "{room_m:.2f} m are left after braking from the {where}"),
    NoticeTemplate("check.trajectory", "within the limits of vehicle and configuration"),
    NoticeTemplate(
        "trajectory.below_floor",
        "at {at_s:.2f} s it is {depth_m:.2f} m below the floor ({key})",
        "in NED z counts down, so 1 m up is -1",
    ),
    NoticeTemplate(
        "trajectory.demand",
        "at {at_s:.2f} s it needs {needed} {unit} of {name}, {bound} {limit} {unit} ({key})",
        "{advice}",
    ),
    NoticeTemplate("trajectory.slower_no_help", "flying it slower does not help"),
    NoticeTemplate("trajectory.slow_down", "slow it down to about {percent} % of its speed"),
    NoticeTemplate(
        "trajectory.slow_down_to", "slow it down to about {speed_m_s:g} m/s (trajectory.speed_m_s)"
    ),
    # Vehicle, link and failsafes.
    NoticeTemplate("check.battery_silent", "the vehicle does not report it"),
    NoticeTemplate("check.battery_unjudged", "{voltage_v:.2f} V; set guards.battery_v to check it"),
    NoticeTemplate("check.battery", "it is at {charge}"),
    NoticeTemplate("check.battery_low", "it is at {charge}", "charge it"),
    NoticeTemplate("check.rtt_unknown", "the link does not measure it"),
    NoticeTemplate("check.rtt", "{rtt_ms:.0f} ms to the vehicle and back, limit {limit_ms:.0f} ms"),
    NoticeTemplate("check.armed_already", "its motors are on already: somebody else has armed it"),
    NoticeTemplate("check.link_state", "the link is {state}"),
    NoticeTemplate("check.link_state_why", "the link is {state}: {text}"),
    NoticeTemplate("check.unfit", "{why}"),
    NoticeTemplate(
        "check.prearm_fails",
        "its own pre-arm checks do not pass, so it may refuse to arm: QGroundControl lists what "
        "they lack{said}",
    ),
    NoticeTemplate("check.ready", "connected, and disarmed{said}"),
    NoticeTemplate("check.conflict", "{why}"),
    NoticeTemplate("check.link_warns", "{why}"),
    NoticeTemplate("check.frames_direct", "commands are sent by this program directly"),
    NoticeTemplate("check.frames_paced", "the pacer and its stand-by have what they need"),
    NoticeTemplate("check.link_drops", "{drops}"),
    NoticeTemplate(
        "check.failsafe_autopilot", "the autopilot's own: `groundstation doctor CONFIG` looks at it"
    ),
    NoticeTemplate(
        "check.failsafe_receiver",
        "the receiver's failsafe must stop the motors, as nothing here can if the module loses "
        "its plug or its computer; it reports no failsafe setting, and many hold the last frame: "
        "once, with the propellers off, `groundstation fly CONFIG`, then pull the module's plug; "
        "the motors must stop",
    ),
    NoticeTemplate(
        "check.thrust_limit",
        "thrust goes to {thrust_n:.3g} N before lift-off, {percent:.0f} % of the weight",
    ),
    NoticeTemplate(
        "check.thrust_limit_high",
        "thrust goes to {thrust_n:.3g} N before lift-off, {percent:.0f} % of the weight, by "
        "takeoff.thrust_limit: with wrong poses or a wrong mass the vehicle jumps higher than "
        "with {usual_n:.3g} N",
    ),
    NoticeTemplate(
        "check.simulated",
        "link.simulated = true: {believed}. Behind {endpoint} no module may be; else take it out",
    ),
    NoticeTemplate("check.bound_no_law", "this controller comes without a Lyapunov function"),
    NoticeTemplate(
        "check.bound",
        "the theory keeps thrust over mass above {bound_m_s2:+.2f} m/s² from rest on the reference",
    ),
    NoticeTemplate(
        "check.bound_by_limit",
        "vehicle.thrust_min_n = {thrust_min_n:g} N keeps it above zero, as the proof alone does "
        "not (its bound: {bound_m_s2:+.2f} m/s² from rest on the reference)",
    ),
    # The test with the propellers off.
    NoticeTemplate("check.props_off_simulated", "only a real vehicle needs one"),
    NoticeTemplate("check.props_off", "passed on {date}"),
    NoticeTemplate(
        "check.props_off_none",
        "no test with the propellers off is on file for {vehicle}: {command}",
    ),
    NoticeTemplate(
        "check.props_off_changed",
        "since the test with the propellers off ({date}) the configuration has changed in one of "
        "{sections}: do it again, {command}",
    ),
    NoticeTemplate(
        "check.props_off_firmware",
        "the test with the propellers off ({date}) was of another firmware, {proven}; this is "
        "{found}: do it again, {command}",
    ),
    # Beside the vehicle: other flights, other bodies, the operator's hand.
    NoticeTemplate("check.flights", "none of this machine has its name, body or link"),
    NoticeTemplate("check.flights_clash", "{clashes}"),
    NoticeTemplate("flights.same_link", "{who} commands {link} as well: stop one of them"),
    NoticeTemplate(
        "flights.same_body",
        "{who} follows the body {body!r} as well: two vehicles can't be one body, so one of them "
        "would fly by the other's poses",
    ),
    NoticeTemplate(
        "flights.same_name",
        "{who} has the same name: whoever arms or lands by name may mean the other",
    ),
    NoticeTemplate("check.bodies_unknown", "the source shows no other bodies"),
    NoticeTemplate("check.bodies_none", "no other body in sight"),
    NoticeTemplate("check.bodies", "{body!r} is {distance_m:.2f} m from {own!r}, the nearest"),
    NoticeTemplate(
        "check.bodies_near",
        "{body!r} is {distance_m:.2f} m from {own!r}, less than vehicle.size_m ({size_m:g} m)",
        "move it away, or find out which name is whose",
    ),
    NoticeTemplate("check.hold_none", "operator.hold names nothing"),
    NoticeTemplate(
        "hold.lost",
        "{what} is lost: {why}",
        "connect it; a device that was unplugged is found by the next flight",
    ),
    NoticeTemplate(
        "hold.free", "{what} is not held", "hold it, and keep holding: let go, and it lands"
    ),
    NoticeTemplate("hold.stuck", "{what} was held from the beginning", "let go once, then hold it"),
    NoticeTemplate("hold.held", "{what} is held: let go, and it lands"),
    NoticeTemplate("hold.unseen", "not read yet"),
    NoticeTemplate("hold.silent", "no value received yet"),
    NoticeTemplate("hold.no_travel", "an axis from {least} to {most} has no travel"),
    NoticeTemplate("hold.untold", "not reported by the autopilot for {age_s:.1f} s"),
    NoticeTemplate(
        "hold.no_receiver", "the autopilot's receiver receives nothing from the transmitter"
    ),
    NoticeTemplate("hold.no_channel", "the receiver has no such channel"),
    NoticeTemplate(
        "hold.linux_only", "keys and axes are read by evdev, which only Linux has; or hold = 'rc:N'"
    ),
    NoticeTemplate(
        "hold.unknown_name", "no key, button or axis has this name (see evtest), got {found!r}"
    ),
    NoticeTemplate("hold.several", "more than one has {name}, name one: {devices}"),
    NoticeTemplate(
        "hold.no_device", "none may be read here: is it plugged in, and are you in the group input?"
    ),
    NoticeTemplate(
        "hold.no_such_device",
        "expected a device that has {name} (evtest lists the keys of each); there are: {devices}",
    ),
    NoticeTemplate(
        "hold.joystick",
        "{value}: {why}",
        "a joystick's /dev/input/js… is another interface, name its …-event-joystick",
    ),
    # What a configuration must have before anything is opened.
    NoticeTemplate(
        "trajectory.refused", "{why}. To see all of it: groundstation trajectory CONFIG"
    ),
    NoticeTemplate(
        "guarded.no_fence",
        "missing, and a real vehicle may fly here ({why})",
        'kind = "box", north_m = [-2, 2], east_m = [-2, 2], height_m = 2.5, or convex',
    ),
    NoticeTemplate(
        "guarded.no_speed",
        "missing, and a real vehicle may fly here ({why})",
        "the highest speed that may be commanded",
    ),
    NoticeTemplate("guarded.start", "expected floor, as a real vehicle may fly here ({why})"),
    # Prompts and the operator's orders by the keyboard.
    NoticeTemplate("arm.prompt", "{vehicle} is ready. Its motors will start. Type its name to arm"),
    NoticeTemplate(
        "arm.prompt_rehearsal",
        "REHEARSAL of {rehearsed}: it is ready, and nothing real will move. Type {vehicle} to arm",
    ),
    NoticeTemplate("arm.no_terminal", "without a terminal, arming needs --arm {vehicle}"),
    NoticeTemplate("arm.other", "expected {vehicle!r}, the vehicle in the config, got {found!r}"),
    NoticeTemplate(
        "arm.service",
        "a service never arms by itself, as it may be started again at any time",
        "start it without, then `groundstation request arm --vehicle {vehicle}`",
    ),
    NoticeTemplate("arm.question", "{prompt}, anything else to stop: "),
)
