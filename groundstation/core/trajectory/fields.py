"""Kinds of number that the configs of several trajectories share. The bounds also keep out inf and nan."""

from typing import Annotated, TypeAlias

import msgspec

Coordinate: TypeAlias = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
"""A coordinate or a height [m], at most 1 km from the origin."""

Point: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
"""A point [m], world NED: north, east, down."""

Length: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
"""A length [m], at least a millimetre."""

Speed: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=50.0)]
"""A speed [m/s], at least a millimetre a second."""

Degrees: TypeAlias = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]
"""An angle [deg]."""

Acceleration: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=50.0)]
"""An acceleration [m/s²]."""

Ramp: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=600.0)]
"""How long it takes to get up to speed, and to stop [s]."""

Moment: TypeAlias = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
"""A time stamp [s], from wherever its clock counts."""
