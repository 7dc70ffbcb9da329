"""One inference core for diagnosis and calibration: motion eliminated, noise fitted, least squares."""
