"""Sentences about recordings: reading, exporting, replaying, importing, evidence, identification,
reports. Sans-IO.
"""

from links.text import NoticeTemplate

ANALYSIS_NOTICES: tuple[NoticeTemplate, ...] = (
    # Recordings, and their export.
    NoticeTemplate(
        "recording.figures",
        "error {rms_cm:.2f} cm RMS, {max_cm:.2f} cm at most, from {from_s:g} s on of "
        "{flown_s:.1f} s on the trajectory; {recorded} in {path}",
    ),
    NoticeTemplate(
        "recording.short",
        "no error figures, which take {least_s:g} s on the trajectory ({flown_s:.2f} s were "
        "flown); {recorded} in {path}",
    ),
    NoticeTemplate(
        "recording.none_figures",
        "error {rms_cm:.2f} cm RMS, {max_cm:.2f} cm at most, from {from_s:g} s on of "
        "{flown_s:.1f} s on the trajectory; not recorded",
    ),
    NoticeTemplate(
        "recording.none_short",
        "no error figures, which take {least_s:g} s on the trajectory ({flown_s:.2f} s were "
        "flown); not recorded",
    ),
    NoticeTemplate(
        "recording.none", "no flight is recorded in {folder}", "name a recording, or fly one"
    ),
    NoticeTemplate("recording.newest", "the newest recording: {path}"),
    NoticeTemplate(
        "recording.no_path", "expected the path of a recording, NAME.mcap, got {found!r}"
    ),
    NoticeTemplate(
        "recording.folder", "{path} is a folder; expected a recording, such as {example}"
    ),
    NoticeTemplate("recording.no_mcap", "{path} is no MCAP file"),
    NoticeTemplate(
        "recording.pipe", "{path} is a pipe, which can't be read twice", "write it to a file first"
    ),
    NoticeTemplate("recording.damaged", "{path} is damaged at byte {at}, before its flight begins"),
    NoticeTemplate(
        "recording.nothing", "nothing that was asked for can be read: the recording {trouble}"
    ),
    NoticeTemplate(
        "recording.no_flight", "{path} is no recording of a flight, or was cut off before it began"
    ),
    NoticeTemplate("recording.no_column", "{topic} has no column {name!r}, but {columns}"),
    NoticeTemplate("recording.bad_config", "the configuration in it is {why}"),
    # Reports and viewers.
    NoticeTemplate(
        "logs.recording",
        "expected CONFIG.toml or a folder; of one flight `groundstation report {path}` tells",
    ),
    NoticeTemplate(
        "report.no_command",
        "{path} holds no command, so there is nothing to report{remark}",
    ),
    # Identification of a vehicle.
    NoticeTemplate(
        "identify.nothing_to_write", "nothing to write: thrust, lags and delay are {why}"
    ),
    NoticeTemplate("identify.no_vehicle", "what was identified is no vehicle: {why}"),
    NoticeTemplate(
        "identify.no_flight", "{path} holds no flight: there are no {what} in it{remark}"
    ),
    NoticeTemplate(
        "identify.short",
        "{path} holds {length_s:.1f} s of unbroken flight on its trajectory, and {least_s:g} s "
        "are the least{remark}",
        "fly trajectory.kind = 'excitation'",
    ),
    NoticeTemplate(
        "identify.other_config",
        "{path} was flown with a configuration that this version cannot read: {why}",
    ),
    # Replay.
    NoticeTemplate(
        "replay.imported",
        "{path} was imported from another program's log, and holds no command of ours",
        "`groundstation replay evidence {path}` examines its poses",
    ),
    NoticeTemplate(
        "replay.own_config", "a recording has its own configuration: change it with --set"
    ),
    NoticeTemplate(
        "replay.foreign_code",
        "flown by {factory}: to replay it, that module is imported here, and its code runs. Where "
        "you trust it, say --trust-modules; or fly your own: --set "
        "controller.factory=package.module:factory",
    ),
    NoticeTemplate(
        "replay.versions",
        "recorded by {recorded}, replayed by {replayed}: the largest difference is {thrust_n:.2g} "
        "N of thrust and {rate_rad_s:.2g} rad/s of body rate",
    ),
    NoticeTemplate(
        "replay.settings", "settings of the recording that this version leaves out: {settings}"
    ),
    # Files of other programs.
    NoticeTemplate("import.no_mapping", "expected a file or one of {known}, got {found!r}"),
    NoticeTemplate("import.damaged", "is no {form} file, or damaged: {why}"),
    NoticeTemplate(
        "import.cut_off", "it is packed by gzip, and its end is missing", "copy it here anew"
    ),
    NoticeTemplate("import.device", "it is a device, not a file"),
    NoticeTemplate("import.no_ulog", "it does not begin with ULog"),
    NoticeTemplate(
        "import.no_version",
        "it does not begin with Format Version, as Motive's export with a header does",
    ),
    NoticeTemplate(
        "import.no_motive_head",
        "no head line found: it has no rows Name and Frame, as Motive's export with a header does",
    ),
    NoticeTemplate(
        "import.no_qtm_head",
        "no head line found: no line names columns X, Y, Z, as QTM's export with column names does",
    ),
    NoticeTemplate("import.two_bodies", "two bodies are called {name}"),
    NoticeTemplate(
        "import.one_body", "only files of Motive and QTM hold several bodies, not {format}"
    ),
    NoticeTemplate("import.one_tlog", "expected one .tlog, got {count} files"),
    NoticeTemplate("import.no_poses", "holds no poses as the mapping has them: {why}"),
    NoticeTemplate("import.no_table", "it has no such table (found: {found})"),
    NoticeTemplate("import.no_column", "no column {columns} (found in {table}: {found})"),
    NoticeTemplate("import.no_row", "no row of numbers (found: {table})"),
    NoticeTemplate(
        "import.time_unit",
        "by {unit!r} a pose comes every {apart_s:.3g} s: its stamps are of another unit",
    ),
    NoticeTemplate("import.one_stamp", "all poses have the same stamp"),
    NoticeTemplate(
        "import.no_head",
        "no head line found: none of the first {rows} lines has a column {names}",
        "check time in the mapping; where the file has no head, write head_rows = 0 in [csv], and "
        "columns by number: "
        '"1" is the first{hint}',
    ),
    NoticeTemplate(
        "import.same_names",
        "several columns are called {name}",
        "where the lines above tell them apart, say how many lines the head has, head_rows in "
        "[csv]{hint}",
    ),
    NoticeTemplate(
        "import.no_body",
        "it holds no rigid body with position and rotation (found: {found})",
        "export rigid bodies from the tracker's program",
    ),
    NoticeTemplate("import.stated", "{key} is {found}, expected {wanted}", "export the file anew"),
    NoticeTemplate(
        "import.no_numbers",
        "no number in column {columns} of {table}",
        "check the columns of the mapping, and that times count in a unit of time_unit",
    ),
    NoticeTemplate(
        "import.bodies", "it holds {count} bodies, {names}", "name the vehicle, --body NAME"
    ),
    NoticeTemplate(
        "import.lengths",
        "its positions move at {speed_m_s:.3g} m/s, limit {fastest_m_s:g} m/s: they are of no room",
        "check position_unit and time_unit of the mapping, and the unit that the file states",
    ),
    NoticeTemplate(
        "import.no_order",
        "{backs:.0f} of {poses:.0f} poses are older than the one before, limit {limit:.0f}",
        "sort its rows by their stamps",
    ),
    # Telemetry logs.
    NoticeTemplate("tlog.no_message", "no MAVLink message in it: is it a .tlog?"),
    NoticeTemplate(
        "tlog.garbage",
        "{garbage} of {size} bytes are no MAVLink record, limit {limit:.0%}",
        "is it a .tlog, with 8 bytes of time before each frame, as MAVProxy, Mission Planner, "
        "QGroundControl and this program write it? It must be whole, and not compressed",
    ),
    NoticeTemplate(
        "tlog.times",
        "{leaps} of {records} log times leap by more than {limit_s:g} s, limit 50%",
        "record it again: 8 bytes before each frame must hold the time in microseconds, big-endian",
    ),
    NoticeTemplate(
        "tlog.one_time",
        "all {records} records have the same log time, so nothing tells when they came",
        "record it again: 8 bytes before each frame must hold the time in microseconds, big-endian",
    ),
    NoticeTemplate(
        "tlog.no_poses",
        "no poses of an autopilot in it (pose messages: {found})",
        "record its ODOMETRY, or its LOCAL_POSITION_NED and ATTITUDE_QUATERNION",
    ),
    # Evidence of a flight by another controller.
    NoticeTemplate(
        "evidence.few_poses",
        "it holds {count} poses, limit {least}{short}",
        "record a longer flight",
    ),
    NoticeTemplate(
        "evidence.few_flown",
        "it holds {count} poses of a flight, limit {least}",
        "record a longer flight",
    ),
    NoticeTemplate(
        "evidence.grounded",
        "the autopilot says that it is on the ground all the time: nothing flies in it",
    ),
    NoticeTemplate("evidence.stands", "it stands all the time: nothing flies in it"),
    NoticeTemplate(
        "evidence.short",
        "it flies for {flown_s:.1f} s, limit {least_s:g} s",
        "record a longer flight",
    ),
    NoticeTemplate("evidence.unbroken", "less than {least_s:g} s of unbroken flight"),
    NoticeTemplate(
        "evidence.leans",
        "it accelerates to its sides, but not as its attitude leans ({shares} times what that "
        "gives)",
        "check units and axes of positions, order and axes of attitudes in the mapping",
    ),
)
