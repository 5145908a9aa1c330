"""The commands that are about RF modules alone: to bind one, and to be the bridge to one."""

import argparse
import asyncio
import os
import signal
from collections.abc import Callable

from groundstation.config import ConfigError, load
from groundstation.flight import is_simulated, key, link_of
from groundstation.runtime import BRIDGE, ApiError, Running, registered
from groundstation.settings import Config
from links.bridge import BridgeConfig
from links.core import LinkError
from links.io import make_key
from links.rf import RF_CODECS, RfLinkConfig, Service

Say = Callable[[str], None]


def serve(args: argparse.Namespace, say: Say) -> bool:
    """Have the module of a radio link bind or check its range, or show it disarmed frames; nothing is ever armed."""
    config = load(args.config, Config, args.overrides)
    if not isinstance(config.link, RfLinkConfig):
        raise ConfigError("link.kind", f"expected one of {sorted(RF_CODECS)}: no other link has a radio module here")
    if not 0.0 < args.seconds <= 3600.0:
        raise ConfigError("--seconds", f"expected more than 0 and at most 3600, got {args.seconds:g}")
    return asyncio.run(_serve(config.link, config.vehicle.thrust_max_n, args.what, args.seconds, say))


async def _serve(config: RfLinkConfig, thrust_max_n: float, what: str, seconds: float, say: Say) -> bool:
    from links.rf import SerialRfLink

    link = SerialRfLink(config, thrust_max_n=thrust_max_n)
    try:
        await link.connect()
        say(f"{config.port}: {what} for {seconds:g} s, disarmed")
        if what == "idle":
            await asyncio.sleep(seconds)
        else:
            await link.serve(Service(what.replace("-", "_")), seconds)
        status = link.status
        say(f"{status.state}: {status.text}")
        if link.report is not None:
            say(f"late by: {_histogram(link.report.late_octaves)}")
    except LinkError as error:
        say(f"{what} failed: {error}")
        return False
    finally:
        await link.close()
    return status.state == "connected"


def _histogram(octaves: tuple[int, ...]) -> str:
    """``<64 µs 12, <128 µs 3`` of counts by lateness; see :class:`links.rf.pacer.PacerReport`."""
    return ", ".join(f"<{2**k} µs {count}" for k, count in enumerate(octaves) if count)


def bridge(args: argparse.Namespace, say: Say) -> bool:
    """Be the bridge until told to end; or make a key."""
    if args.make_key is not None:
        try:
            make_key(args.make_key)
        except ValueError as error:
            raise ConfigError("--make-key", str(error)) from None
        say(f"{args.make_key}: a new key, for your eyes only. Copy it to the other computer by a safe way, mode 0600")
        return True
    if args.config is None:
        raise ConfigError(
            "CONFIG.toml", "expected a configuration, or --make-key FILE; see docs/how-to/two-computers.md"
        )
    config = load(args.config, BridgeConfig, args.overrides)
    shared = key(config.key_file, "key_file")
    one = Running(pid=os.getpid(), command=BRIDGE, vehicle=config.listen, link=link_of(config.link))
    try:
        with registered(one):
            return asyncio.run(_bridge(config, shared, say))
    except ApiError as error:
        raise ConfigError("XDG_RUNTIME_DIR", str(error)) from None


async def _bridge(config: BridgeConfig, shared: bytes, say: Say) -> bool:
    from links.bridge import Bridge

    loop = asyncio.get_running_loop()
    link = config.link
    real = not is_simulated(link)
    it = Bridge(config, shared, say=lambda line: say(f"{loop.time():.3f} {line}"), remote_only=real)
    running = asyncio.ensure_future(it.run())

    def end(name: str) -> None:
        running.cancel()
        say(f"{name}: ending; what flies is brought down first. Ctrl-\\ (SIGQUIT) stops its motors")

    def kill() -> None:
        it.kill()
        say("SIGQUIT: motors off, now")

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, end, number.name)
    loop.add_signal_handler(signal.SIGQUIT, kill)
    if real:
        say(f"{link.port} may be a real module: whoever has the key {config.key_file} can start its vehicle's motors")
    say(
        f"rf-bridge at udp {config.listen}: {link.__struct_config__.tag} module on {link.port}, a frame every "
        f"{1e3 * link.period_s:g} ms. Ctrl-C ends"
    )
    try:
        await running
    except asyncio.CancelledError:
        if it.dropped:
            say(f"datagrams dropped: {dict(it.dropped)}")
        return True
    except LinkError as error:
        say(str(error))
    return False
