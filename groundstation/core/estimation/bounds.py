"""Bounds of gains and noises: a value beyond one is in another unit, or no vehicle from 20 g to
25 kg flies by it.
"""

from typing import Annotated

import msgspec

Gain = Annotated[float, msgspec.Meta(ge=0.02, le=200.0)]
"""A gain, slope or bandwidth [1/s]: no rotor answers within 5 ms, so that no loop around it can
decay faster; what takes longer than 50 s steers nothing that flies."""
GainOrOff = Annotated[float, msgspec.Meta(ge=0.0, le=200.0)]
"""A gain [1/s], or any less, down to zero."""
PositionGain = Annotated[float, msgspec.Meta(ge=0.02, le=1000.0)]
"""A gain from position to acceleration [1/s²]: that of 1000 swings 5 times a second, faster than
vehicles can tilt."""
IntegralGain = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]
"""A gain from the integral of a speed error to acceleration [1/s²], or zero; bound as
:data:`PositionGain`."""
SpeedBound = Annotated[float, msgspec.Meta(ge=0.01, le=100.0)]
"""A speed [m/s]; ``gate.speed_m_s`` believes no faster one."""
AccelerationBound = Annotated[float, msgspec.Meta(ge=0.01, le=200.0)]
"""An acceleration [m/s²]: no rotors give 20 times a vehicle's weight."""
Ratio = Annotated[float, msgspec.Meta(ge=0.01, le=100.0)]
"""A bound or slope of ρ [- or s/m]: ten times the largest that is of use, as k2 ρ is an
acceleration; of less than 0.01, that is below the bias of an estimate."""
AccelerationGain = Annotated[float, msgspec.Meta(ge=0.0, le=2.0)]
"""A gain from acceleration to acceleration [-]: beyond 2 each correction is larger than twice its
error."""
FilterTime = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A time constant of a filter [s]; more is in milliseconds."""
WitnessGain = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]
"""κ [1/s per kb], or zero: with a kb of 0.2, a pull of 200 1/s, the largest :data:`Gain`."""
Smoothing = Annotated[float, msgspec.Meta(ge=1e-4, le=10.0)]
"""δ [m²/s⁴]: of 10, it adds 1 m/s² to the projection (docs/explanation/law.md, P3) at the least B
of 5 m/s²; of 0.0001, it adds a hundred-thousandth of that."""
Gravity = Annotated[float, msgspec.Meta(ge=1.0, le=30.0)]
"""An acceleration of free fall [m/s²]: the Moon has 1.6, Jupiter 25; less is in g."""
PoseNoise = Annotated[float, msgspec.Meta(ge=1e-6, le=0.1)]
"""A noise of positions [m]; more, where `gate.jump_m` lets no pose pass, is in millimetres."""
VelocityNoise = Annotated[float, msgspec.Meta(ge=1e-4, le=2.0)]
"""A noise of velocities [m/s]: more tells less than the positions do, and no source measures a
tenth of a millimetre per second."""
VelocityBias = Annotated[float, msgspec.Meta(ge=0.0, le=2.0)]
"""An error of velocities [m/s], or zero; bound as :data:`VelocityNoise`."""
Wander = Annotated[float, msgspec.Meta(ge=0.0, le=2.0)]
"""A random walk of positions [m/√s]: ten times that of a receiver of satellites; more is in
millimetres."""
MarkerWander = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
"""A random walk of a tracker's positions [m/√s]; more is in millimetres."""
ModelNoise = Annotated[float, msgspec.Meta(ge=1e-4, le=5.0)]
"""Noise density of the model's acceleration [m/s² per √Hz]; more is a model that knows nothing, and
that of a good accelerometer is 0.001."""
WindNoise = Annotated[float, msgspec.Meta(ge=1e-4, le=50.0)]
"""Noise density of the disturbance [m/s³ per √Hz]: of more, a storm grows by 5 g within a second;
of less, the air changes by 0.001 m/s² within a minute."""
WindRateNoise = Annotated[float, msgspec.Meta(ge=1e-3, le=500.0)]
"""Noise density of the disturbance's rate [m/s⁴ per √Hz]: ten times :data:`WindNoise`, within a
tenth of a second."""
ThrustDeviation = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A standard deviation of the thrust's scale [-]; more is in percent."""
ThrustWander = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
"""A random walk of the thrust's scale [1/√s]: of 0.1, all thrust is gone after 100 s; more is in
percent."""
Jitter = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A noise of stamps [s]; more is in milliseconds."""
