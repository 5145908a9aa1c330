"""The vehicle as the controller is told it is: its figures, limits, model and actuators."""
