"""Sentences of screens and commands in flight: dashboard, request, stop-all, fleets. Sans-IO."""

from links.text import NoticeTemplate

SCREEN_NOTICES: tuple[NoticeTemplate, ...] = (
    # The dashboard's answers to keys.
    NoticeTemplate("screen.closed", "the ground station closed its status socket"),
    NoticeTemplate(
        "screen.other_station", "{path}: another ground station (process {pid}) serves there"
    ),
    NoticeTemplate("screen.no_station", "no ground station serves {path}"),
    NoticeTemplate("screen.not_sent", "NOT SENT: no ground station is there"),
    NoticeTemplate("screen.no_answer", "NO ANSWER, the request may be lost: {why}"),
    NoticeTemplate(
        "screen.old", "what is shown is older than {limit_s:g} s: nothing is ordered by it"
    ),
    NoticeTemplate(
        "screen.key_held",
        "the key is held down, which is no second press",
        "press it twice to kill",
    ),
    NoticeTemplate(
        "screen.ctrl_c",
        "NOTHING WAS ORDERED: Ctrl-C is no order on this screen",
        "Ctrl-L lands, Ctrl-X aborts, Ctrl-K twice stops the motors; q leaves",
    ),
    NoticeTemplate("screen.no_vehicle", "there is no vehicle to show"),
    NoticeTemplate("screen.take_first", "take control first", "key c"),
    NoticeTemplate("screen.arm", "The motors of {vehicle} will start. Type its name:"),
    NoticeTemplate("screen.fly", "{vehicle} leaves the hold for its trajectory"),
    NoticeTemplate("screen.all_landed", "land all: {count} answered"),
    NoticeTemplate("screen.some_silent", "{says}"),
    NoticeTemplate("screen.gain_control", "gains need control", "key c"),
    NoticeTemplate(
        "screen.only_looks", "NOTHING WAS ORDERED: this screen may only look", "go to the station"
    ),
    NoticeTemplate("screen.read_only", "read only: orders nothing"),
    NoticeTemplate("screen.control_free", "control is free: c takes it"),
    NoticeTemplate(
        "screen.leave",
        "{vehicle} is {state}. Without this screen the flight goes on; nobody is asked to land",
    ),
    NoticeTemplate("screen.left", "the flight of {vehicle} goes on ({state})"),
    NoticeTemplate("screen.recording", "a recording can't be asked for anything"),
    NoticeTemplate(
        "screen.gain",
        "now {now:g}; one change goes from {least:g} to {most:g}. It gets there within "
        "{ramp_s:g} s, and goes back by itself where the error or V rises",
    ),
    NoticeTemplate("screen.no_number", "{typed!r} is no number: nothing was changed"),
    NoticeTemplate("screen.no_gain", "{typed} is no gain: nothing was changed"),
    NoticeTemplate("screen.other_name", "{typed!r} is not {wanted!r}: nothing was done"),
    NoticeTemplate("screen.no_terminal", "a dashboard needs a terminal; {otherwise}"),
    NoticeTemplate(
        "screen.paste", "{count} keys dropped: a paste? What you pressed yourself, press again"
    ),
    NoticeTemplate(
        "screen.paste_open",
        "a paste had no end: what came meanwhile was its text. What you pressed yourself, press "
        "again",
    ),
    # The process behind a dashboard.
    NoticeTemplate("screen.served", "a ground station serves {path} already; to see it: {again}"),
    NoticeTemplate("screen.core_ended", "it has ended ({how}): {last}"),
    NoticeTemplate(
        "screen.begins_anew",
        "the dashboard has failed and begins anew; the ground station goes on as process {pid}",
    ),
    NoticeTemplate("screen.busy", "the ground station is still busy, see {log}"),
    NoticeTemplate(
        "screen.goes_on", "the ground station goes on as process {pid}; what it says is in {log}"
    ),
    NoticeTemplate(
        "screen.station_ended", "the ground station has ended. {ended}\nWhat it said is in {log}"
    ),
    NoticeTemplate("screen.silent_log", "it has said nothing"),
    # Requests and stop-all.
    NoticeTemplate("request.no_answer", "no answer within {limit_s:g} s"),
    NoticeTemplate("request.nobody", "{path}: no ground station serves there"),
    NoticeTemplate(
        "request.name_it", "arm moves the vehicle, and must name it: --vehicle {vehicle}"
    ),
    NoticeTemplate(
        "request.other_vehicle", "{path}: the vehicle there is {found!r}, not {wanted!r}"
    ),
    NoticeTemplate("stop_all.answered", "{who}: {answer}"),
    NoticeTemplate("stop_all.socket", "its socket {socket}: {why}"),
    NoticeTemplate("stop_all.ended", "{who}: {trouble}, and it has ended"),
    NoticeTemplate(
        "stop_all.signal",
        "{who}: NOT ANSWERED: {trouble}; {signal} sent ({means} as soon as it runs)",
        "take the remote control and see that it comes down",
    ),
    NoticeTemplate("stop_all.bridge_killed", "{who}: SIGQUIT sent: motors off"),
    NoticeTemplate("stop_all.bridge_ended", "{who}: it has ended"),
    NoticeTemplate(
        "stop_all.bridge",
        "{who}: goes on, as what flies by it lands by its station's commands. kill {pid} ends it "
        "and brings down what flies; kill -QUIT {pid} stops its motors",
    ),
    NoticeTemplate("stop_all.fleet", "{who}: it was starting, and is ended before it arms"),
    NoticeTemplate(
        "stop_all.needs_yes",
        "stops the motors of {names} in the air: without a terminal it needs --yes",
    ),
    NoticeTemplate("stop_all.question", "Motors off, AND THEY FALL: {names}. Type yes: "),
    NoticeTemplate("stop_all.not_done", "nothing was done: without --kill they land"),
    NoticeTemplate(
        "stop_all.foreign",
        "{folder} is of user {user}: sudo -u {user} groundstation stop-all reaches what flies "
        "there",
    ),
    NoticeTemplate("stop_all.nothing", "nothing flies here"),
    # Fleets.
    NoticeTemplate(
        "fleet.relay_away",
        "{target} is not on this machine, and copies go by its loopback addresses alone",
        "name a core here, such as 127.0.0.1:51101",
    ),
    NoticeTemplate(
        "fleet.relay_loop",
        "the relay listens at {target} itself, and would hear its own copies for ever",
        "give each core a port of its own",
    ),
    NoticeTemplate("fleet.no_relay", "the relay did not begin: nothing was started"),
    NoticeTemplate(
        "fleet.relay_ended",
        "WARNING: the relay has ended ({how}): no vehicle gets poses any more, and their guards "
        "bring each of them down",
    ),
    NoticeTemplate("fleet.nobody_armed", "nobody is armed: {names} did not get ready"),
    NoticeTemplate("fleet.not_armed", "{name}: not armed: {why}"),
    NoticeTemplate("fleet.core_early", "{name}: its core has ended before it could fly"),
    NoticeTemplate(
        "fleet.core_died",
        "{name}: WARNING: its core has died ({how}) and is not started again: the vehicle "
        "does what it does when commands stop. The others fly on",
    ),
    NoticeTemplate("fleet.core_ended", "{name}: its core has ended ({code})"),
    NoticeTemplate("fleet.passed_on", "{signal}: passed on to {names}"),
)
