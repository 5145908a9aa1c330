"""The dashboard: a process of its own."""

from groundstation.interfaces.tui.app import fly_with_screen, tui_command
from groundstation.interfaces.tui.fleet import run_fleet
