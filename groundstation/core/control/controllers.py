"""Controllers to fly with: the table of their kinds, and a user's own, loaded by name.

``ControllerConfig`` has one line for each kind; a user's own is ``controller.kind = "package.module:factory"``.
"""

import inspect
import math
import sys
import warnings
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Annotated, Any, TypeAlias

import msgspec

from groundstation.config import (
    FACTORY,
    ConfigError,
    OpenFactory,
    Option,
    UserCodeFault,
    call_factory,
    find_object,
    needed_names,
)
from groundstation.core.control.adaptive import Adaptive, Gains, Uncompensated
from groundstation.core.control.attitude import clamp_command, make_decision
from groundstation.core.control.baselines import L1, Geometric, Indi, Pid
from groundstation.core.estimation import Estimation
from groundstation.core.messages import Controller, Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Vehicle

KEY = "controller.kind"


class Custom(
    Estimation, OpenFactory, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="custom"
):
    """A factory and its options. Written shorter: ``kind = "package.module:factory"``, options beside it."""

    factory: Annotated[str, msgspec.Meta(pattern=FACTORY)]
    """Where the controller comes from: ``package.module:factory``, called as factory(vehicle, options) or with as much
    of it as it needs; or a function decide(estimate, reference, interval_s) itself."""
    options: dict[str, Option] = msgspec.field(default_factory=dict)
    """What the factory gets beside the vehicle."""

    @property
    def kind(self) -> str:
        """The factory's name."""
        return self.factory

    def build(self, vehicle: Vehicle) -> Controller:
        """The user's controller, within the vehicle's limits.

        Raises:
            ConfigError: it can't be imported, is not there, can't be called, fails, or makes no controller.
        """
        _hand_on_old_paths()
        found = find_object(KEY, self.factory)
        if not callable(found) and not hasattr(found, "decide"):
            raise ConfigError(KEY, f"{self.factory} is not callable: expected factory(vehicle, options) -> Controller")
        controller: Any
        if inspect.isroutine(found) and len(needed_names(found, self.options) or ()) == 3:
            controller = SimpleNamespace(decide=found)
        else:
            controller = call_factory(KEY, self.factory, found, (vehicle,), self.options)
        if not callable(getattr(controller, "decide", None)):
            made = type(controller).__name__
            raise ConfigError(KEY, f"{self.factory} made a {made} without decide(estimate, reference, interval_s)")
        return Guarded(controller, vehicle, self.factory)


class Guarded:
    """Any controller, its commands brought within the vehicle's limits; anything that is no command ends the flight."""

    def __init__(self, controller: Controller, vehicle: Vehicle, name: str) -> None:
        """``name`` is for the operator."""
        self._controller = controller
        self._vehicle = vehicle
        self._name = name

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """The controller's decision, its command clamped; one of thrust and rates alone is made a whole one.

        Raises:
            UserCodeFault: it failed, or what it returned is not a command of four finite numbers.
        """
        try:
            decision: Any = self._controller.decide(estimate, reference, interval_s)
        except Exception as error:
            raise UserCodeFault(f"controller {self._name}", error) from error
        if isinstance(decision, ActuatorCommand):
            decision = self._make_whole(decision, estimate, reference)
        if not isinstance(decision, Decision):
            raise UserCodeFault(f"controller {self._name} returned a {type(decision).__name__}, not a Decision")
        try:
            thrust = float(decision.drive.thrust)
            x, y, z = (float(rate) for rate in decision.drive.rates)
        except (AttributeError, TypeError, ValueError):
            raise UserCodeFault(f"controller {self._name} returned no thrust and three rates") from None
        if not all(map(math.isfinite, (thrust, x, y, z))):
            raise UserCodeFault(f"controller {self._name} asked for thrust {thrust} N, rates {(x, y, z)} rad/s")
        drive, clamped = clamp_command(self._vehicle, thrust, (x, y, z))
        return decision._replace(drive=drive, saturated=bool(decision.saturated) or clamped)

    def _make_whole(self, drive: ActuatorCommand, estimate: Estimate, reference: Reference) -> Any:
        """A decision of ``drive``; whatever is no number in it is found where all answers are looked at."""
        still = make_decision(self._vehicle, estimate, reference, 0.0, (0.0, 0.0, 0.0))
        return still._replace(drive=drive, saturated=False)


OLD_PATHS = (
    "groundstation.control", "groundstation.control.attitude", "groundstation.control.baseline",
    "groundstation.control.decision", "groundstation.control.port", "groundstation.core.control.decision",
    "groundstation.core.controllers", "groundstation.core.controllers.baseline", "groundstation.trajectories",
    "groundstation.trajectories.port", "groundstation.vehicle",
)  # fmt: skip
"""Modules from which docs/how-to/own-controller.md once had a controller import; for one release they hand on."""
RENAMED = {"Outlet": "InnerLoop", "decided": "make_decision", "limited": "clamp_command"}
"""What they called otherwise."""


def _hand_on_old_paths() -> None:
    """Have the old paths hand on what :mod:`groundstation` hands on now, with a word of advice."""
    for path in OLD_PATHS:
        stand_in = ModuleType(path)
        stand_in.__dict__.update(__path__=[], __getattr__=partial(_find_public, path))
        sys.modules.setdefault(path, stand_in)


def _find_public(path: str, name: str) -> object:
    if name.startswith("_"):  # what asks every module for its file, say
        raise AttributeError(name)
    public = RENAMED.get(name, name)
    found: object = getattr(sys.modules["groundstation"], public)
    warnings.warn(
        f"{path}.{name} has moved, and the old path goes with the next release: write `from groundstation import "
        f"{public}{'' if public == name else f' as {name}'}`",
        FutureWarning,
        stacklevel=2,
    )
    return found


ControllerConfig: TypeAlias = Gains | Uncompensated | Geometric | L1 | Pid | Indi | Custom
"""Any controller as the config file tells it, picked by its ``kind``, with what its estimator is told."""


def make_controller(config: ControllerConfig, vehicle: Vehicle) -> Controller:
    """The controller that ``config`` describes.

    Raises:
        ConfigError: a controller of the user's own can't be loaded.
    """
    return Adaptive(vehicle, config) if isinstance(config, Gains) else config.build(vehicle)
