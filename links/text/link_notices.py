"""Table of the sentences of links: id, severity, sentence with named numbers, remedy. Sans-IO.

What a link reports to the operator is made here; the ground station's own table takes these rows
in.
"""

from links.text.sentence import NoticeTable, NoticeTemplate

LINK_NOTICES: tuple[NoticeTemplate, ...] = (
    # Keys whose values do not go together, and addresses.
    NoticeTemplate(
        "address.none",
        "{found!r} is not an address: write host:port such as 127.0.0.1:14550 or [::1]:14550, its "
        "port from 1 to 65535",
    ),
    NoticeTemplate("mavlink.exclusive", "{keys} exclude each other: leave only one of them"),
    NoticeTemplate(
        "mavlink.local_port",
        "local_port is the port from which `remote` is spoken to: give remote, or leave it out",
    ),
    NoticeTemplate(
        "mavlink.no_estimate",
        "bring_down = 'land' needs a position estimate on board, and ardupilot_mode = "
        "'GUIDED_NOGPS' says that there is none: leave out one of them",
    ),
    NoticeTemplate(
        "mavlink.forward_rate",
        "forward.rate_hz: {rate_hz:g} poses a second are {bytes_s:.0f} bytes a second, too much "
        "beside commands at baud = {baud}: lower the rate, or use a faster port",
    ),
    NoticeTemplate("rf.no_travel", "low and high are the same: the throttle would not move"),
    NoticeTemplate(
        "rf.reversed", "low must be smaller than high; reverse single channels in the map"
    ),
    NoticeTemplate("rf.never_disarms", "armed and disarmed are the same: it could never disarm"),
    NoticeTemplate(
        "rf.channel_twice", "channel {channel} is given to two things: give each its own"
    ),
    NoticeTemplate(
        "rf.few_channels", "map names channel {channel}, but these frames carry {count} channels"
    ),
    NoticeTemplate(
        "rf.long_frame",
        "a frame of {bytes} bytes takes {frame_ms:.2f} ms at {baud} baud, too long for a period "
        "of {period_ms:g} ms",
    ),
    NoticeTemplate("rf.lead", "lead_s must be shorter than period_s"),
    NoticeTemplate(
        "rf.betaflight_channels", "Betaflight takes thrust and rates from channels 1 to 8"
    ),
    # Parameters of an autopilot.
    NoticeTemplate("parameter.no_value", "{found} is no value for a parameter"),
    NoticeTemplate(
        "parameter.whole_number", "expected a whole number from {least} to {most}, got {found:g}"
    ),
    # MAVLink: the way to the autopilot.
    NoticeTemplate("mavlink.open", "cannot open {endpoint} for MAVLink ({why}): {advice}"),
    NoticeTemplate(
        "address.refused",
        "check that it is there, that you may open it, and that no other program has it",
    ),
    NoticeTemplate(
        "address.taken",
        "another program holds this port, and `ss -lunp` names it: end it, or give another "
        "address of this machine; or two keys of the configuration have the same address",
    ),
    NoticeTemplate(
        "address.unknown_host",
        "nobody knows the name in it: correct it, or write the address in numbers",
    ),
    NoticeTemplate(
        "address.not_ours",
        "no interface of this machine has this address: `ip address` lists those that have one",
    ),
    NoticeTemplate(
        "address.forbidden",
        "the system refuses it, as it does broadcast addresses, and ports below 1024 to ordinary "
        "users: give another",
    ),
    NoticeTemplate(
        "mavlink.local_port_taken",
        "cannot open {endpoint} for MAVLink ({why}): another program holds UDP port {port} of "
        "this machine, from which it is spoken to, and `ss -lunp` names it; end it, or give "
        "another port in link.local_port",
    ),
    NoticeTemplate(
        "mavlink.silent",
        "no HEARTBEAT of MAVLink system {system}, component {component} on {endpoint} within "
        "{limit_s:g} s: {what}",
        "check that the autopilot runs, that it sends to this address, and its system id "
        "(MAV_SYS_ID or SYSID_THISMAV)",
    ),
    NoticeTemplate(
        "mavlink.silent_port",
        "{silent}. PX4 answers only the first port that it heard since it started, and this "
        "program speaks from port {port}",
        "if another program or port spoke to it before, restart the autopilot, or give that port "
        "in link.local_port",
    ),
    NoticeTemplate("mavlink.closed_early", "the link was closed before it was open"),
    NoticeTemplate("mavlink.closed", "the link was closed before the autopilot answered"),
    NoticeTemplate("mavlink.key", "link.signing_key_file: {why}"),
    NoticeTemplate("mavlink.lost", "the link is lost: {why}; trying again every {pause_s:g} s"),
    NoticeTemplate(
        "mavlink.lost_heartbeat",
        "the link is lost: no HEARTBEAT of the autopilot for {silence_s:.0f} s",
    ),
    NoticeTemplate("mavlink.wire_back", "the wire is back: waiting for the autopilot's HEARTBEAT"),
    NoticeTemplate("mavlink.back", "the link is back after it was lost: arm anew to fly"),
    NoticeTemplate("mavlink.back_but", "the link is back after it was lost, but: {why}"),
    NoticeTemplate("mavlink.tcp_silent", "the other end acknowledges nothing any more"),
    NoticeTemplate("mavlink.tcp_closed", "the other end closed the TCP connection"),
    NoticeTemplate("mavlink.tcp_broken", "the TCP connection broke ({why})"),
    NoticeTemplate("mavlink.tcp_nobody", "nobody accepts within {limit_s:g} s"),
    NoticeTemplate(
        "mavlink.port_stuck", "the port takes nothing any more", "check flow control and wiring"
    ),
    NoticeTemplate("mavlink.port_gone", "the port is gone ({why})"),
    NoticeTemplate("mavlink.stamp_range", "{stamp} is not from 0 to {last}"),
    NoticeTemplate(
        "mavlink.stamp_unread", "cannot read the newest time stamp in {path} ({why}): remove it"
    ),
    NoticeTemplate(
        "mavlink.stamp_unwritten", "cannot write {path} ({why}): signing needs it, or stamps repeat"
    ),
    # MAVLink: who else is heard.
    NoticeTemplate(
        "mavlink.two_on_one",
        "{count} autopilots with MAVLink system id {system} answer from {address} (hardware ids "
        "{ids}): all would obey. Switch off all but one, or give each its own system id "
        "(MAV_SYS_ID or SYSID_THISMAV)",
    ),
    NoticeTemplate(
        "mavlink.replaced",
        "the autopilot at {address}{hardware} is not the one that was checked at {checked}",
        "check the vehicle again",
    ),
    NoticeTemplate(
        "mavlink.two",
        "{count} autopilots with MAVLink system id {system} are heard: one at {address}{hardware}, "
        "to which commands go, and {others}. Switch off all but one, or give each "
        "its own system id (MAV_SYS_ID or SYSID_THISMAV) and port",
    ),
    NoticeTemplate(
        "mavlink.two_paths",
        "the autopilot is heard from two addresses, {address} and {other}: only the first is "
        "used. End the second path",
    ),
    NoticeTemplate(
        "mavlink.rival",
        "{rival}, to this vehicle, too: it would follow both by turns. End that program",
    ),
    NoticeTemplate(
        "mavlink.rival_sends", "MAVLink system {system}, component {component}, sends {message}"
    ),
    # Arming, disarming, landing.
    NoticeTemplate("arming.abandoned", "arming was abandoned: {why}"),
    NoticeTemplate(
        "arming.idle_expired",
        "arming was abandoned: the idle command had expired, as its pose is too old",
    ),
    NoticeTemplate("arming.slept", "arming was abandoned: this computer slept"),
    NoticeTemplate("arming.killed", "arming was abandoned: the motors were killed"),
    NoticeTemplate("arming.motors_killed", "the motors were killed"),
    NoticeTemplate(
        "kill.closed",
        "the link is closed: nothing can be sent. Use the remote control's kill switch",
    ),
    NoticeTemplate(
        "kill.unanswered",
        "no answer to “motors off”, sent {count} times. Use the remote control's kill switch",
    ),
    NoticeTemplate(
        "kill.refused",
        "{autopilot} refused to stop the motors ({because}): {reason}. Use the remote control's "
        "kill switch",
    ),
    NoticeTemplate(
        "autopilot.unanswered",
        "no answer to the request to {what}, sent {count} times: the autopilot is heard but does "
        "not hear us, or does not take commands from our system id; check the address it sends to",
    ),
    NoticeTemplate(
        "autopilot.still_armed",
        "still armed {patience_s:g} s after mode LAND",
        "stop the motors with the remote control",
    ),
    NoticeTemplate(
        "autopilot.refused", "{autopilot} refused to {what} ({because}): {reason}. {hint}"
    ),
    NoticeTemplate("autopilot.no_reason", "it gave no reason"),
    NoticeTemplate("autopilot.no_mode", "it did not tell its mode within {limit_s:g} s"),
    NoticeTemplate(
        "autopilot.keeps_parameter",
        "{autopilot} keeps {name} at {got:g} instead of {wanted:g}: {reason}",
    ),
    NoticeTemplate("autopilot.unfit_parameter", "{name} is {value:g}: {hint}"),
    NoticeTemplate(
        "autopilot.unknown_kind",
        "system {system} is no PX4 and no ArduPilot ({kind}): nobody tried how it takes body "
        "rates, so it is not armed",
    ),
    NoticeTemplate(
        "autopilot.no_multirotor",
        "{autopilot} says that its vehicle is no multirotor ({vehicle}): it may take our thrust "
        "for something else, so it is not armed. Set its frame or airframe to the multirotor "
        "that it is",
    ),
    NoticeTemplate("autopilot.no_landing", "nobody knows how {kind} is told to land"),
    NoticeTemplate(
        "hint.mode",
        "Switch to {mode} by hand to see what it lacks: it needs an attitude and our stream of "
        "set-points.",
    ),
    NoticeTemplate(
        "hint.arm", "Clear what it names (its pre-arm checks tell more), then arm again."
    ),
    NoticeTemplate(
        "hint.guid_options",
        "it would take our thrust as a climb rate. Add 8 to GUID_OPTIONS (bit 3, thrust as "
        "thrust; `groundstation doctor` does), then arm again.",
    ),
    NoticeTemplate(
        "hint.angle_boost",
        "it would raise our thrust whenever the vehicle leans, on top of the controller, which "
        "does so already. Set ATC_ANGLE_BOOST to 0 (`groundstation doctor` does), then arm again.",
    ),
    NoticeTemplate(
        "hint.disarm",
        "It must stand on the ground at zero thrust; the remote control's kill switch always "
        "works.",
    ),
    NoticeTemplate("hint.land_disarmed", "Stop the motors with the remote control."),
    NoticeTemplate("hint.land", "The bring-down by rates went on instead."),
    NoticeTemplate(
        "hint.stream",
        "This autopilot may not have the message; do without what it is for (pose.kind, "
        "operator.hold).",
    ),
    # Transmitter modules and the process that paces their frames.
    NoticeTemplate(
        "module.dead",
        "the pacer and its stand-by ended, and with them every frame",
        "close the link, and connect it again",
    ),
    NoticeTemplate("module.failsafe_acts", "the receiver's failsafe has to act: {why}"),
    NoticeTemplate(
        "module.unsent", "nothing can be sent, the receiver's failsafe has to act: {why}"
    ),
    NoticeTemplate("module.closed", "the link is closed"),
    NoticeTemplate(
        "module.untimely",
        "where frames leave commands count no more, as none had come in time, or as the program "
        "there ends: what it held is played to its end, bring-down and all",
    ),
    NoticeTemplate(
        "module.no_orders", "the pacer takes no orders", "close the link, and connect it again"
    ),
    NoticeTemplate("arming.not_taken", "the pacer did not take the arming"),
    NoticeTemplate(
        "module.no_service", "a module of this kind takes no order to {service}: see its own menu"
    ),
    NoticeTemplate("module.service_armed", "no {service} while armed", "disarm first"),
    NoticeTemplate("module.closed_early", "the link was closed before it was done"),
    NoticeTemplate("module.closed_connecting", "the link was closed before it was connected"),
    NoticeTemplate(
        "module.heir",
        "{why}; its stand-by has taken over and brings down",
        "close the link, and connect it again",
    ),
    NoticeTemplate(
        "module.alone",
        "the pacer's stand-by {wrong}: should the pacer end too, nothing but the receiver's "
        "failsafe brings the vehicle down; land, and connect the link again",
    ),
    NoticeTemplate("module.frames_late", "frames may leave late, by {note}"),
    NoticeTemplate("module.priority_ordinary", "ordinary priority, as configured"),
    NoticeTemplate(
        "module.priority_refused",
        "ordinary priority: SCHED_FIFO is not allowed (set rtprio in /etc/security/limits.conf)",
    ),
    NoticeTemplate(
        "module.priority_unlocked",
        "SCHED_FIFO {priority}, memory not locked (set memlock in /etc/security/limits.conf)",
    ),
    NoticeTemplate("module.priority", "SCHED_FIFO {priority}, memory locked"),
    NoticeTemplate(
        "module.stands_dead",
        "the pacer stands still, and its stand-by is dead: the receiver's failsafe has to act; "
        "nothing leaves before one goes on, and then disarm frames",
    ),
    NoticeTemplate(
        "module.stands",
        "the pacer's stand-by stands still, and the pacer too, unless it is dead: the receiver's "
        "failsafe has to act; nothing leaves before one goes on, and then disarm frames",
    ),
    NoticeTemplate(
        "module.linux_only",
        "only Linux can pace an RF module; a bridge on a computer with Linux can have it: "
        "rf_bridge",
    ),
    NoticeTemplate(
        "module.ended_at_once", "the pacer ended at once, with code {code}", "see what it printed"
    ),
    NoticeTemplate(
        "module.other_clock",
        "the pacer's clock is not the event loop's: deadlines would mean nothing to it",
    ),
    NoticeTemplate("module.not_started", "the pacer did not start within {limit_s:g} s"),
    NoticeTemplate("module.pacer_killed", "the pacer was killed (signal {signal})"),
    NoticeTemplate("module.pacer_failed", "the pacer failed (code {code})"),
    NoticeTemplate("module.pacer_stood", "the pacer stood still and was ended"),
    NoticeTemplate("module.port", "cannot open {path}: {why}"),
    NoticeTemplate(
        "module.port_gone",
        "the module's port is gone ({why})",
        "check the module's cable and supply",
    ),
    NoticeTemplate(
        "module.port_stuck",
        "the module's port takes nothing any more",
        "check the module's cable and supply, and its adapter",
    ),
    # Flight controllers with Betaflight, by their own port.
    NoticeTemplate("board.other_firmware", "{port}: expected Betaflight, this is {found!r}"),
    NoticeTemplate(
        "board.other", "{port}: another board than before answers there; nothing more was changed"
    ),
    NoticeTemplate("board.port", "{port}: {why}"),
    NoticeTemplate(
        "board.unknown_command", "{port}: the board does not know MSP command {command}"
    ),
    NoticeTemplate(
        "board.silent",
        "nothing there answers MSP: is it the flight controller's own port, and nobody else's? "
        "One whose command line was left open answers once it was switched off and on",
    ),
    NoticeTemplate("board.armed_unknown", "nobody knows whether it is armed: {why}"),
    NoticeTemplate(
        "board.armed",
        "the vehicle is armed: settings are looked at and changed only while it is not",
    ),
    NoticeTemplate(
        "board.may_arm",
        "the board does not say that its command line keeps it from arming: nothing is changed",
    ),
    NoticeTemplate("board.refuses", "the board refuses `{line}`: {why}"),
    NoticeTemplate("board.no_answer", "the board's command line says nothing to `{line}`"),
    NoticeTemplate("board.port_ended", "the port has ended"),
    # A bridge on another computer.
    NoticeTemplate("bridge.refuses", "the bridge at {address} refuses: {why}"),
    NoticeTemplate(
        "bridge.unheard",
        "the bridge at {address} is not heard: where it still runs, it brings down and disarms by "
        "itself",
    ),
    NoticeTemplate("bridge.unreachable", "cannot reach {address}: {why}"),
    NoticeTemplate(
        "bridge.silent",
        "no answer from a bridge at {address} within {limit_s:g} s: is it running there, and with "
        "the same key?",
    ),
    NoticeTemplate(
        "bridge.dropped",
        "no answer from a bridge at {address} within {limit_s:g} s: what came was dropped: "
        "{dropped}",
    ),
    NoticeTemplate("bridge.there", "on the bridge: {says}"),
    NoticeTemplate("bridge.key", "{why}"),
    NoticeTemplate("bridge.pacer_ended", "the pacer ended; it is being started again"),
    NoticeTemplate("bridge.restarts", "the pacer ended: starting it again, disarmed"),
    NoticeTemplate("bridge.port_back", "the port is back, disarmed"),
    NoticeTemplate("bridge.armed", "the vehicle is armed"),
    NoticeTemplate("bridge.disarmed", "the vehicle is disarmed"),
    NoticeTemplate(
        "bridge.local_station",
        "a station on this machine ({address}) is not heard",
        "give the flight the module itself, by link.kind = {kind!r} and link.port",
    ),
    NoticeTemplate("bridge.commands", "station {host}:{port} commands"),
    NoticeTemplate("bridge.leaves", "station {host}:{port} leaves"),
    NoticeTemplate("bridge.busy", "it obeys another station, or brings a vehicle down"),
    NoticeTemplate("bridge.listen", "cannot listen at {address}: {why}"),
    # Serial ports, keys, addresses.
    NoticeTemplate("port.missing", "no such port; plug in the adapter, or correct its name"),
    NoticeTemplate(
        "port.forbidden",
        "permission denied; join the group that owns it (often dialout) and log in again",
    ),
    NoticeTemplate("port.busy", "another program uses it; stop that first"),
    NoticeTemplate("port.not_serial", "it is no serial port"),
    NoticeTemplate(
        "port.speed", "it can't go at {baud} baud, only at {speed}", "take another adapter"
    ),
    NoticeTemplate("file.unread", "cannot read {path}: {why}"),
    NoticeTemplate("key_file.no_file", "{path} is no file"),
    NoticeTemplate(
        "key_file.other_owner",
        "{path} belongs to another user: whoever owns it knows the key; make a new one of your own",
    ),
    NoticeTemplate(
        "key_file.mode",
        "{path} has mode {mode}, so others may know the key",
        "make a new one, chmod 600",
    ),
    NoticeTemplate(
        "key_file.none", "{path} is no key: expected {bytes} bytes, raw or as hex or base64 text"
    ),
    NoticeTemplate("key_file.zeros", "{path} holds only zeros, which is no key"),
    NoticeTemplate("file.unwritten", "cannot write {path}: {why}"),
)

link_notice = NoticeTable(LINK_NOTICES).notice
"""Makes a sentence of a link from the id of its row and its numbers."""
