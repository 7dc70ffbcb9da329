"""Kalman filters in banks: the Gaussian-sum filter and MPF-PN, the program's."""
