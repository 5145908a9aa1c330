"""Health of the poses: gate, response to the commands, latency, second witness."""

from groundstation.core.health.health import SUSPECT_M_S2, Failure, HealthState, PoseHealth
from groundstation.core.health.latency import PoseLatency, ResponseLatency
from groundstation.core.health.pose_gate import PoseGate
from groundstation.core.health.witness import MOUNTING_DEG, Agreement, Witness
