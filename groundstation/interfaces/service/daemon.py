"""``groundstation daemon``: one flight after the other, each armed anew by somebody who names the vehicle."""

import asyncio
import os
from collections.abc import Callable
from contextlib import suppress

from groundstation.core.messages import Ask, Reply, Request, Snapshot, SourceError
from groundstation.core.mission import FINAL, ON_GROUND, State
from groundstation.flight import Flight, Outcome
from groundstation.interfaces.api import Server
from groundstation.interfaces.service.crew import crew
from groundstation.interfaces.service.health import WRITE_S, Health, HealthFile, health_path
from groundstation.interfaces.service.notify import Notify
from groundstation.recording import make_flight, recorder
from groundstation.runtime import Exit, Quiet, running
from groundstation.settings import Config
from links.core import LinkError

PAUSE_S = 2.0
"""Between a flight's end and the next one's beginning [s]; it doubles while none gets as far as to be armed, ..."""
PAUSE_MAX_S = 30.0
"""... up to this [s]."""
RENEW_S = 3600.0
"""What has waited so long to be armed begins anew, and its recording with it [s]: poses at rest would fill the disk."""


class Daemon:
    """Flies when it is told to, until it is stopped."""

    def __init__(
        self, config: Config, say: Callable[[str], None], notify: Notify, *, arm: bool = False, once: bool = False
    ) -> None:
        """``arm``: the first flight arms without being asked. ``once``: end with the first flight."""
        self._config = config
        self._say = say
        self._notify = notify
        self._arm = arm
        self._once = once
        self._quiet = Quiet()
        self._armed = 0
        self._stop = asyncio.Event()
        self._server: Server | None = None
        self._flight = self._made(None)

    # ---- what may be asked of it, as of a flight

    def ask(self, request: Request) -> Reply:
        """Ask the flight that is, or was last."""
        return self._flight.ask(request)

    def set_gain(self, key: str, value: float) -> Reply:
        """Ask the flight."""
        return self._flight.set_gain(key, value)

    def note(self, text: str) -> None:
        """Tell the flight's events."""
        self._flight.note(text)

    def snapshot(self) -> Snapshot:
        """The flight as it is now, or as it ended."""
        return self._flight.snapshot()

    def stop(self) -> None:
        """No flight after this one. Whoever asks the flight to land does that beside it."""
        self._stop.set()
        self._notify.stopping()

    # ---- its life

    async def run(self) -> Exit:
        """Serve clients, and fly, until :meth:`stop`, or with ``once`` until the first flight is over.

        Raises:
            ApiError: the socket can't be served.
            SourceError, LinkError, OSError: the first flight can't begin.
        """
        await self._notify.open()
        try:
            async with crew(self._config, self, self._say, self._quiet, needed=True) as server:
                self._server = server
                health = HealthFile(health_path(server.path))
                pulse = asyncio.ensure_future(self._pulse(server, health))
                try:
                    return await self._flights()
                finally:
                    pulse.cancel()
                    await asyncio.gather(pulse, return_exceptions=True)
                    health.remove()
        finally:
            self._notify.close()

    async def _flights(self) -> Exit:
        pause_s, first = PAUSE_S, True
        self._notify.ready()
        while not self._stop.is_set():
            before = self._armed
            try:
                outcome = await self._fly()
            except (SourceError, LinkError, OSError) as error:
                if self._once or first:
                    raise
                outcome = Outcome(State.ABORTED, str(error), str(error))
                self._say(f"warning: this flight could not begin: {error}")
            first = False
            flew = self._armed > before
            if self._once or (flew and self._stop.is_set()):
                return Exit.DONE if outcome.state is State.LANDED and not outcome.fault else Exit.FAULT
            pause_s = PAUSE_S if flew else min(2.0 * pause_s, PAUSE_MAX_S)
            self._notify.status(f"{self._flight.state}; the next flight gets ready in {pause_s:g} s")
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stop.wait(), pause_s)
        return Exit.DONE

    async def _fly(self) -> Outcome:
        """One flight from connecting to its end, recorded; of one that was never armed no recording is kept."""
        before = self._armed

        def keep() -> bool:
            return self._armed > before or self._once

        async with recorder(self._config, self._say, self._quiet, keep) as give:
            self._flight = self._made(give)
            renewing = asyncio.ensure_future(self._renew(self._flight))
            try:
                return await self._flight.run()
            finally:
                renewing.cancel()

    def _made(self, give: Callable[..., None] | None) -> Flight:
        return make_flight(
            self._config,
            confirm=self._confirm,
            on_event=self._say,
            on_state=self._entered,
            give=give,
            quiet=self._quiet,
            running=running,
        )

    async def _confirm(self) -> bool:
        """Arm by itself only where the operator has said so on the command line, and only once."""
        if not self._arm:
            name = self._config.vehicle.name
            self._say(f"ready, and staying on the ground: `groundstation request arm --vehicle {name}` makes it fly")
            await asyncio.Event().wait()
        return True

    def _entered(self, state: State, reason: str) -> None:
        if state is State.ARMING:
            self._armed += 1
            self._arm = False
        if state in FINAL:
            self._arm = False
        self._notify.status(f"{state}: {reason}")

    async def _renew(self, flight: Flight) -> None:
        """End a flight that nobody has armed for long, unless somebody is about to."""
        if not self._config.recording.enabled or self._arm:
            return
        while True:
            await asyncio.sleep(RENEW_S)
            held = self._server is not None and self._server.desk.is_held
            if flight.state in ON_GROUND and flight.state is not State.ARMING and not held:
                flight.ask(Request(Ask.LAND, "nothing has flown for an hour: a new recording begins"))

    async def _pulse(self, server: Server, health: HealthFile) -> None:
        """Feed the watchdog and write the health file, from the loop that flies: a loop that hangs does neither."""
        loop = asyncio.get_running_loop()
        period_s = min(WRITE_S, self._notify.feed_s or WRITE_S)
        written_s = -WRITE_S
        while True:
            if self._notify.feed_s is not None:
                self._notify.feed()
            now = loop.time()
            if now - written_s >= WRITE_S - 0.01:
                written_s = now
                await self._quiet.moment()
                health.draft(self._health(server, loop.time()))
                await self._quiet.moment()
                health.publish()
            await asyncio.sleep(period_s)

    def _health(self, server: Server, now_s: float) -> Health:
        flight = self._flight
        tick_s = flight.newest_tick_s
        return Health(
            vehicle=self._config.vehicle.name,
            state=flight.state,
            reason=flight.reason,
            pid=os.getpid(),
            written_s=now_s,
            tick_age_s=None if tick_s is None else now_s - tick_s,
            flights=self._armed,
            refused=dict(server.refused),
        )
