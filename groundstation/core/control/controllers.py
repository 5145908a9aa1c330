"""Controllers to fly with: the table of their kinds, and a user's own, loaded by name.

``ControllerConfig`` has one line for each kind; a user's own is ``controller.kind = "package.module:factory"``.
"""

import importlib
import math
import re
import sys
import warnings
from functools import partial
from types import ModuleType
from typing import Annotated, Any, ClassVar, TypeAlias

import msgspec

from groundstation.config import ConfigError, Open
from groundstation.core.control.adaptive import Adaptive, Gains, Uncompensated
from groundstation.core.control.attitude import clamp_command
from groundstation.core.control.baselines import Geometric, Indi, Pid
from groundstation.core.estimation import Estimation
from groundstation.core.messages import Controller, Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle

FACTORY = r"\A[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*\Z"
"""``package.module:factory``."""
KEY = "controller.kind"

Option = bool | int | float | str | list[bool | int | float | str]
"""What an option may be; NaN and infinity are refused as everywhere."""


class Custom(Estimation, Open, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="custom"):
    """A factory and its options. Written shorter: ``kind = "package.module:factory"``, options beside it."""

    EXAMPLE: ClassVar[str] = "package.module:factory"
    factory: Annotated[str, msgspec.Meta(pattern=FACTORY)]
    """Where the controller comes from: ``package.module:factory``, called as factory(vehicle, options)."""
    options: dict[str, Option] = msgspec.field(default_factory=dict)
    """What the factory gets beside the vehicle."""

    @property
    def kind(self) -> str:
        """The factory's name."""
        return self.factory

    @classmethod
    def expand(cls, table: dict[str, Any]) -> dict[str, Any]:
        """``table`` in this struct's own form where its ``kind`` names a factory, else as it is."""
        kind = table.get("kind")
        if not isinstance(kind, str) or not re.match(FACTORY, kind):
            return table
        own = {field.encode_name for field in msgspec.structs.fields(cls)} - {"factory"}
        kept = {key: value for key, value in table.items() if key in own}
        given = {key: value for key, value in table.items() if key not in own and key != "kind"}
        if given:
            inner = kept.get("options", {})
            kept["options"] = {**inner, **given} if isinstance(inner, dict) else inner
        return {"kind": "custom", "factory": kind, **kept}

    def build(self, vehicle: Vehicle) -> Controller:
        """The user's controller, within the vehicle's limits.

        Raises:
            ConfigError: it can't be imported, is not there, can't be called, fails, or makes no controller.
        """
        module_name, _, name = self.factory.partition(":")
        _hand_on_old_paths()
        try:
            module = importlib.import_module(module_name)
        except Exception as error:  # whatever the user's module raises, the operator must hear of it
            raise ConfigError(
                KEY, f"can't import {module_name}: {_describe(error)} (is its folder on PYTHONPATH, or it installed?)"
            ) from error
        factory = getattr(module, name, None)
        if factory is None:
            raise ConfigError(KEY, f"{module_name} has no attribute {name!r}")
        if not callable(factory):
            raise ConfigError(KEY, f"{self.factory} is not callable: expected factory(vehicle, options) -> Controller")
        try:
            controller = factory(vehicle, dict(self.options))
        except Exception as error:  # as above
            raise ConfigError(KEY, f"{self.factory} failed: {_describe(error)}") from error
        if not callable(getattr(controller, "decide", None)):
            found = type(controller).__name__
            raise ConfigError(KEY, f"{self.factory} made a {found} without decide(estimate, reference, interval_s)")
        return Guarded(controller, vehicle, self.factory)


class ControllerFault(Exception):
    """A user's controller answered with something that must not leave."""


class Guarded:
    """Any controller, its commands brought within the vehicle's limits; anything that is no command ends the flight."""

    def __init__(self, controller: Controller, vehicle: Vehicle, name: str) -> None:
        """``name`` is for the operator."""
        self._controller = controller
        self._vehicle = vehicle
        self._name = name

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """The controller's decision, its command clamped.

        Raises:
            ControllerFault: what it returned is not a Decision of four finite numbers.
        """
        decision = self._controller.decide(estimate, reference, interval_s)
        if not isinstance(decision, Decision):
            raise ControllerFault(f"controller {self._name} returned a {type(decision).__name__}, not a Decision")
        try:
            thrust = float(decision.drive.thrust)
            x, y, z = (float(rate) for rate in decision.drive.rates)
        except (AttributeError, TypeError, ValueError):
            raise ControllerFault(f"controller {self._name} returned no thrust and three rates") from None
        if not all(map(math.isfinite, (thrust, x, y, z))):
            raise ControllerFault(f"controller {self._name} asked for thrust {thrust} N, rates {(x, y, z)} rad/s")
        drive, clamped = clamp_command(self._vehicle, thrust, (x, y, z))
        return decision._replace(drive=drive, saturated=bool(decision.saturated) or clamped)


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


def _describe(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


ControllerConfig: TypeAlias = Gains | Uncompensated | Geometric | Pid | Indi | Custom
"""Any controller as the config file tells it, picked by its ``kind``, with what its estimator is told."""


def make_controller(config: ControllerConfig, vehicle: Vehicle) -> Controller:
    """The controller that ``config`` describes.

    Raises:
        ConfigError: a controller of the user's own can't be loaded.
    """
    return Adaptive(vehicle, config) if isinstance(config, Gains) else config.build(vehicle)
