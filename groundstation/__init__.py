"""Offboard flight of quadrotors: poses in, thrust and body rates out.

For scripts and notebooks (docs/reference/python.md):

    simulate            fly one scenario in virtual time, with a controller or trajectory of your
                        own; gives a Run
    compare             fly several controllers through the same scenarios; gives a
                        ControllerComparison
    error_budget        fly a recorded flight again without each source of its error; gives an
                        ErrorBudget
    load                read a recorded flight: a FlightData of arrays, tables and pictures
    ask_station         ask a vehicle that is being flown here, as `groundstation request` does: a
                        Request, with its Ask
                        and for goto its Waypoints; gives an OrderAnswer

What a controller of your own asks for (docs/how-to/own-controller.md), each loaded when it is asked
for:

    Controller          the port: decide(estimate, reference, interval_s) -> Decision
    Estimate            the vehicle when the command will act, with the disturbance that the
                        observer sees
    Motion              its position, velocity, attitude, thrust and body rates in an estimate
    Reference           where the vehicle should be at that instant, with exact derivatives
    Decision            the command, whether it was clamped, and what screens show of it
    ActuatorCommand     thrust [N] and body rates [rad/s, FRD]
    Diagnostics         what a control law says about itself at one step
    Vehicle             what the controller is told of the vehicle: mass, limits, lags
    make_decision       a Decision of thrust and body rates, within the vehicle's limits
    clamp_command       an ActuatorCommand within the vehicle's limits, and whether it had to be
                        clamped
    specific_thrust     thrust per mass for a wanted acceleration, tilted no further than a limit
    sine_error          the turn that brings the thrust along a direction, as the sine of its angle
    half_angle_error    the same, as twice the sine of half the angle
    turning             the body rates at which the direction of a changing thrust turns
    UserCodeFault       what a flight ends in where code of your own fails
    ConfigError         what is raised for a wrong name, key or value
    ApiError            what is raised where no station answers to ask_station
    Baseline, InnerLoop heading, limits and lags: from a wanted thrust and turn to a Decision, as
    the baselines do it
"""

from groundstation.runtime.version import __version__ as __version__

TYPE_CHECKING = False
# Each as itself, as type checkers take no other name for one that is handed on.
# What stands in sim is handed on, too: the one exception to what stands above what.
if TYPE_CHECKING:
    from groundstation.analysis.recordings import FlightData as FlightData, load as load
    from groundstation.config.errors import ConfigError as ConfigError
    from groundstation.config.user_code import UserCodeFault as UserCodeFault
    from groundstation.core.control.attitude import (
        clamp_command as clamp_command,
        half_angle_error as half_angle_error,
        make_decision as make_decision,
        sine_error as sine_error,
        specific_thrust as specific_thrust,
        turning as turning,
    )
    from groundstation.core.control.controllers import Baseline as Baseline, InnerLoop as InnerLoop
    from groundstation.core.messages.snapshot import (
        Ask as Ask,
        Controller as Controller,
        Decision as Decision,
        Diagnostics as Diagnostics,
        Estimate as Estimate,
        Request as Request,
        Waypoint as Waypoint,
    )
    from groundstation.core.trajectory.reference import Reference as Reference
    from groundstation.core.vehicle.vehicle import (
        ActuatorCommand as ActuatorCommand,
        Motion as Motion,
        Vehicle as Vehicle,
    )
    from groundstation.interfaces.api.client import ask_station as ask_station
    from groundstation.interfaces.api.messages import OrderAnswer as OrderAnswer
    from groundstation.machine.register import ApiError as ApiError
    from sim.runs.simulation import Run as Run, simulate as simulate
    from sim.studies.budget import ErrorBudget as ErrorBudget, error_budget as error_budget
    from sim.studies.comparison import (
        ControllerComparison as ControllerComparison,
        compare as compare,
    )

_MODULES = {
    "FlightData": "groundstation.analysis.recordings",
    "load": "groundstation.analysis.recordings",
    "ConfigError": "groundstation.config.errors",
    "UserCodeFault": "groundstation.config.user_code",
    "clamp_command": "groundstation.core.control.attitude",
    "half_angle_error": "groundstation.core.control.attitude",
    "make_decision": "groundstation.core.control.attitude",
    "specific_thrust": "groundstation.core.control.attitude",
    "sine_error": "groundstation.core.control.attitude",
    "turning": "groundstation.core.control.attitude",
    "Baseline": "groundstation.core.control.controllers",
    "InnerLoop": "groundstation.core.control.controllers",
    "Ask": "groundstation.core.messages.snapshot",
    "Controller": "groundstation.core.messages.snapshot",
    "Decision": "groundstation.core.messages.snapshot",
    "Diagnostics": "groundstation.core.messages.snapshot",
    "Estimate": "groundstation.core.messages.snapshot",
    "Request": "groundstation.core.messages.snapshot",
    "Waypoint": "groundstation.core.messages.snapshot",
    "Reference": "groundstation.core.trajectory.reference",
    "ActuatorCommand": "groundstation.core.vehicle.vehicle",
    "Motion": "groundstation.core.vehicle.vehicle",
    "Vehicle": "groundstation.core.vehicle.vehicle",
    "ask_station": "groundstation.interfaces.api.client",
    "OrderAnswer": "groundstation.interfaces.api.messages",
    "ApiError": "groundstation.machine.register",
    "Run": "sim.runs.simulation",
    "simulate": "sim.runs.simulation",
    "ErrorBudget": "sim.studies.budget",
    "error_budget": "sim.studies.budget",
    "ControllerComparison": "sim.studies.comparison",
    "compare": "sim.studies.comparison",
}
"""Module of each public name, loaded when it is first asked for (PEP 562)."""


if not TYPE_CHECKING:  # a type checker shall know a name that is not there

    def __getattr__(name: str) -> object:
        from importlib import import_module

        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        try:
            return getattr(import_module(_MODULES[name]), name)
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "sim":
                raise
            from groundstation.config import config_notice

            raise ImportError(config_notice("package.no_simulator", name=name)) from None


def __dir__() -> list[str]:
    """Return the names for a notebook's tab key, before any of them is loaded."""
    return sorted({*globals(), *_MODULES})
