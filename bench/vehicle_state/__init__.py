"""State filters of a car on slipping tyres, of which only benchmarks make use: EKF, UKF, UPF and ARUPF."""
