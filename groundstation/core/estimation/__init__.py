"""The estimator: a Kalman filter at the newest pose, rolled forward through the commands sent since."""
