"""Preparation of a laboratory and its vehicles: parameters, axes, propellers off, fleets."""

from groundstation.lab.doctor import DoctorOrders, run_doctor
from groundstation.lab.fleet import FleetPlan, Member, read_fleet
from groundstation.lab.pose_monitor import carry_command, watch_poses
from groundstation.lab.pose_stream import MOVES, CarryMove
from groundstation.lab.props_off import props_off_command
from groundstation.lab.relay import Relay, run_relay
