"""Sentences of the station: recorder, service, screens, MQTT. Sans-IO."""

from links.text import NoticeTemplate, as_warnings

STATION_NOTICES: tuple[NoticeTemplate, ...] = (
    # The recorder. A flight goes on without it.
    NoticeTemplate("recording.begins", "recording to {path}"),
    NoticeTemplate(
        "recording.tidied",
        "recordings: {name} was removed to keep within recording.keep_gb and keep_days",
    ),
    NoticeTemplate("recording.forgotten", "{name} was removed: nothing was armed in it"),
    # The service, its log, and signals. Of a key, `does` is the request that it made, and `then`
    # the effect of the next press (core/mission/operator.py).
    NoticeTemplate("service.stopped", "{what} stopped: {why}"),
    NoticeTemplate("service.next", "{state}; the next flight gets ready in {pause_s:g} s"),
    NoticeTemplate(
        "service.waits",
        "ready, and waiting on the ground to be armed: `groundstation request arm --vehicle "
        "{vehicle}` makes it fly",
    ),
    NoticeTemplate("service.renews", "nothing has flown for an hour: a new recording begins"),
    NoticeTemplate("key.step", "{key}: {does}; {then}"),
    NoticeTemplate(
        "key.bounce", "{key} within {once_s:g} s, or held down, counts once: {does}; {then}"
    ),
    NoticeTemplate("key.kill", "{key}: motors off, now"),
    NoticeTemplate("key.lands", "{key}: asked to land"),
    NoticeTemplate("key.no_pause", "Ctrl-Z is ignored: nobody would fly the vehicle. Ctrl-C lands"),
    # Orders of clients, over the socket of this machine or from afar, by MQTT.
    NoticeTemplate("station.lost", "the connection is lost"),
    NoticeTemplate("station.closed", "the ground station has closed the connection"),
    NoticeTemplate("station.no_answer", "{path}: no answer within {limit_s:g} s"),
    NoticeTemplate("station.no_greeting", "{path}: no greeting within {limit_s:g} s"),
    NoticeTemplate("station.other_version", "no snapshot of this version at {path}: {why}"),
    NoticeTemplate(
        "station.other_user",
        "{path} is for user {user} alone",
        "do the same as that user, by sudo -u {user}",
    ),
    NoticeTemplate("station.unserved", "nobody serves at {path}: {why}"),
    NoticeTemplate("order.not_one", "an order has exactly one of ask, control and set"),
    NoticeTemplate("order.keys", "expected an object with one key"),
    NoticeTemplate(
        "order.late", "it came {late_s:.1f} s too late: nothing was done; order it again"
    ),
    NoticeTemplate("order.needs_control", "needs control, which {holder} holds", "take it first"),
    NoticeTemplate(
        "order.other_vehicle", "arm must name the vehicle: expected {expected!r}, got {found!r}"
    ),
    NoticeTemplate(
        "order.arm_from_afar", "nobody arms from afar: only who stands by the vehicle may"
    ),
    NoticeTemplate(
        "order.controlled_here",
        "{holder} holds control at the station: from afar it can only be brought down",
    ),
    NoticeTemplate("order.not_allowed", "{client} may not ask for {ask}"),
    NoticeTemplate("control.gone", "{client} has gone, and held control: nobody does now"),
    NoticeTemplate("control.held", "{client} holds control"),
    NoticeTemplate("control.given", "{client} has given control away"),
    NoticeTemplate("control.yours", "you hold control"),
    NoticeTemplate("control.yours_already", "you hold control already"),
    NoticeTemplate("control.other", "{client} holds control; it must give it first, or go"),
    NoticeTemplate("control.not_yours", "you do not hold control; {client} does"),
    NoticeTemplate("control.free", "nobody holds control now"),
    # MQTT.
    NoticeTemplate("mqtt.closed", "the broker has closed the connection"),
    NoticeTemplate(
        "mqtt.login_refused",
        "the login was refused, {why}",
        "check the user's name and password",
    ),
    NoticeTemplate(
        "mqtt.refused",
        "nothing listens there",
        "start the broker, or check its host and port",
    ),
    NoticeTemplate("mqtt.broker_failed", "the broker {broker}: {why}"),
    NoticeTemplate("mqtt.publishing", "publishing to {broker}"),
    NoticeTemplate("recording.no_end", "{reason}, when the ground station died"),
    *as_warnings(
        # The recorder. A flight goes on without it.
        NoticeTemplate(
            "recording.ended", "WARNING: recording has ended, the flight goes on: {path}: {why}"
        ),
        NoticeTemplate("recording.not", "WARNING: not recording, the flight goes on: {why}"),
        NoticeTemplate("recording.no_file", "WARNING: {path} is not written: {why}"),
        NoticeTemplate("recording.no_tlog", "WARNING: no .tlog of this flight: {why}"),
        NoticeTemplate(
            "recording.unrecordable", "WARNING: a part of this flight can't be recorded: {why}"
        ),
        NoticeTemplate(
            "recording.still_writing", "WARNING: the recorder is still writing; it ends by itself"
        ),
        NoticeTemplate(
            "recording.died",
            "WARNING: the recorder has died ({how}); the flight goes on and is no longer recorded",
        ),
        # The service, its log, and signals.
        NoticeTemplate("log.lost", "{count} log lines were lost: nobody read them"),
        NoticeTemplate("service.no_flight", "this flight could not begin: {why}"),
        # Orders of clients, here and from afar.
        NoticeTemplate(
            "order.none", "{client} has sent a line that is no order ({why}): nothing was done"
        ),
        NoticeTemplate("order.not_killed", "NOT KILLED, {reason}: {why}"),
        # MQTT.
        NoticeTemplate("mqtt.no_broker", "not publishing to {broker}, and trying again: {why}"),
        NoticeTemplate(
            "mqtt.no_requests",
            "the broker does not let us read {topic}: no requests; look at its access rules",
        ),
        NoticeTemplate("mqtt.dropped", "request by MQTT dropped, {reason} ({count} so far): {why}"),
    ),
)
