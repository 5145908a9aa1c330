"""Flight controller: phases and their references, the descent after failed poses, and the
controller itself.
"""

from groundstation.flight.controller.course import Course
from groundstation.flight.controller.flight_controller import LAST_CHANCE_S, FlightController
