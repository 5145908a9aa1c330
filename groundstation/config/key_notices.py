"""Sentences about keys whose values do not go together, and about the files that keys name.

Sans-IO.

A sentence about one key begins with that key, below its section.
"""

from links.text import NoticeTemplate

KEY_NOTICES: tuple[NoticeTemplate, ...] = (
    # Vehicles and fences.
    NoticeTemplate(
        "file.in_python",
        "{key}: only a configuration can name one",
        "read it with groundstation.config.loader.from_dict",
    ),
    NoticeTemplate(
        "vehicle.nested_file", "file: a vehicle file can't name another; it may name a preset"
    ),
    NoticeTemplate(
        "vehicle.missing", "missing: {keys}; say all of it, or name a preset to start from"
    ),
    NoticeTemplate(
        "vehicle.lift",
        "vehicle.{key}: full thrust of {most_n:.4g} N is {times:.4g} times the weight, "
        "{weight_n:.4g} N by mass_kg = {mass_kg:g}: expected {least:g} to {most:g} times; correct "
        "one of these (mass in kilograms, thrust in newtons)",
    ),
    NoticeTemplate(
        "vehicle.full_thrust",
        "vehicle.thrust_max_n: {most_n:.4g} N is more than the full signal gives, {full_n:.4g} N "
        "by mass_kg, hover_thrust and the thrust curve (f = {curve:g}): lower it, or correct one "
        "of these",
    ),
    NoticeTemplate(
        "vehicle.least_thrust",
        "vehicle.thrust_min_n: expected less than the weight, {weight_n:.4g} N by mass_kg = "
        "{mass_kg:g}, got {found_n:g}",
    ),
    NoticeTemplate(
        "vehicle.hover_range",
        "vehicle.hover_range: expected a share below 1 and one above 1, got {found}: the weight "
        "itself would be outside",
    ),
    NoticeTemplate(
        "vehicle.hover",
        "vehicle.hover_n: expected {least_n:.4g} to {most_n:.4g} N, vehicle.hover_range of the "
        "weight, got {found_n:g}",
    ),
    NoticeTemplate("fence.order", "north_m and east_m: expected the smaller number first"),
    NoticeTemplate(
        "fence.convex", "corners_m: expected a convex polygon, its corners one after the other"
    ),
    # Trajectories.
    NoticeTemplate(
        "trajectory.ramp",
        "ramp_s: expected at most {length_s:.3g} s, all there is to fly, got {ramp_s:g}",
    ),
    NoticeTemplate(
        "trajectory.short_ramp", "ramp_s: expected 0 or at least {least_s:g} s, got {ramp_s:g}"
    ),
    NoticeTemplate(
        "trajectory.no_ramp",
        "laps: needs ramp_s above 0, or it would have to stop within no time at the end",
    ),
    NoticeTemplate(
        "trajectory.swing",
        "yaw_swing_deg: expected 0 or from {least_deg:g} to 90 [deg], got {found_deg:g}: is it in "
        "radians?",
    ),
    NoticeTemplate(
        "trajectory.band",
        "highest_hz: expected at least {least_hz:.3g} Hz with this lowest_hz and period_s",
    ),
    NoticeTemplate(
        "trajectory.same_point",
        "points_ned[{index}]: the same as the one before; leave it out, or give times_s",
    ),
    NoticeTemplate("trajectory.open", "laps: the last point must be the first one again"),
    NoticeTemplate("trajectory.points", "laps: at most {most} points in all"),
    NoticeTemplate(
        "trajectory.lists", "{key}: expected one for each of the {points} points, got {count}"
    ),
    NoticeTemplate(
        "trajectory.times",
        "times_s[{index}]: expected at least 1 ms after {before_s:g}, the one before it, got "
        "{found_s:g}",
    ),
    NoticeTemplate(
        "trajectory.unit",
        "times_s: {length_m:.3g} m in {lasts_s:.6g} s is slower than {slowest_mm_s:g} mm/s: times "
        "count in seconds, points in metres",
    ),
    # Courses in a CSV file.
    NoticeTemplate("course.not_csv", "line {line}: {why}"),
    NoticeTemplate(
        "course.few_lines",
        "expected a line of names, such as {example}, and {least} or more lines of numbers",
    ),
    NoticeTemplate(
        "course.names", "line {line}: expected names of columns, such as {example}, got {found!r}"
    ),
    NoticeTemplate("course.twice", "line {line}: the column {name} is there twice"),
    NoticeTemplate(
        "course.no_column", "line {line}: expected a column {names}: none of them is there"
    ),
    NoticeTemplate(
        "course.two_columns", "line {line}: expected a column {names}: only one of them"
    ),
    NoticeTemplate("course.values", "line {line}: expected {count} values, got {found}"),
    NoticeTemplate(
        "course.number",
        "line {line}, column {name}: expected a number from -{bound:g} to {bound:g}, got {found!r}",
    ),
    NoticeTemplate(
        "course.order",
        "line {line}, column t_s: expected more than {before_s:g}, as before it, got {found_s:g}",
    ),
    NoticeTemplate("course.unusable", "has {key}, which trajectory.kind = {kind!r} can't use"),
    NoticeTemplate("course.both", "has {key} too: leave out trajectory.{key}, or the file"),
    # Sections of a whole configuration.
    NoticeTemplate(
        "keys.blind",
        "guards.level_s: flight.coast_s and it make {blind_s:g} s, the limit is 1 s: commands "
        "would have no valid pose for too long; set one of them lower",
    ),
    NoticeTemplate(
        "keys.forward",
        "link.forward.enabled: the poses are the autopilot's own, it must not get them as new",
    ),
    NoticeTemplate(
        "keys.others_unseen",
        "separation.others: poses of kind {kind} show no other vehicle: leave it out",
    ),
    NoticeTemplate(
        "keys.others_twice",
        "separation.others: expected each other vehicle once, and not this one's own object",
    ),
    NoticeTemplate(
        "keys.hold_channel",
        "operator.hold: a channel of the transmitter is reported by link.kind mavlink alone",
    ),
    NoticeTemplate(
        "keys.hold",
        "operator.hold: expected a key, button or axis as evtest names it, such as BTN_TR, KEY_B "
        "or ABS_RZ, or rc:1 to rc:18, got {found!r}",
    ),
    NoticeTemplate("keys.certificate", "cert_file and key_file: expected both, or none"),
    NoticeTemplate(
        "keys.tls", "enabled: expected true where any other key of TLS is set, got false"
    ),
    NoticeTemplate(
        "keys.no_clients",
        "clients: expected at least one where enabled = true; or leave requests off",
    ),
    NoticeTemplate(
        "keys.authority", "authority: expected move, as {client} may goto, got {found!r}"
    ),
    NoticeTemplate("keys.client", "clients: expected {form}, got {found!r}"),
    NoticeTemplate(
        "keys.unencrypted",
        "host: {host!r} is another machine, and nothing would be encrypted: set mqtt.tls.enabled "
        "= true, or mqtt.insecure = true if everybody on the network may read it",
    ),
    NoticeTemplate("keys.username", "username: expected a name beside password_file"),
    NoticeTemplate("keys.ipv4", "{key}: expected a numeric IPv4 address, got {found!r}"),
    NoticeTemplate(
        "keys.multicast",
        "{key}: expected a multicast address, such as 239.255.42.99, got {found!r}",
    ),
    NoticeTemplate("keys.no_multicast", "{key}: expected no multicast address, got {found!r}"),
    NoticeTemplate(
        "keys.arm",
        "link.map.arm: expected armed and disarmed on either side of the middle, far from it",
    ),
)
