"""The car's own motion on slipping tyres: slips in closed form, and filters of the vehicle state.

Filters: EKF, UKF, UPF and ARUPF of [Liu 2022]. State: lateral speed v, longitudinal speed u, yaw rate r, at
the centre of gravity. Inputs: longitudinal acceleration and the angle of the road wheels. Readings: lateral
acceleration, yaw rate and, where it is known, u. Where a term differs from the print:

- the rear axle's moment has the rear track, and the lateral forces of the rear wheels (in (3) and (5) their
  longitudinal ones stand);
- the wheel loads are divided by the wheelbase, and the rear pair carries a/l, not b, of the lateral transfer;
  they sum to m g;
- Dugoff's lateral force is divided by 1 + sigma;
- the gain is P_xz inv(P_zz), the covariance loses K P_zz K';
- the printed norm of the adaptive factor adds metres to radians per second; here each state counts in its own
  standard deviations;
- an adaptive factor of 0 would make (20) singular, for two readings do not fix three states: it is floored at
  0.02;
- whether a reading is an outlier is judged once, by all particles together.

What the paper leaves open: the wheels' slip is taken from the force that carries m a_x, as wheel speeds would
need the radii that are sought. Loads use the steady a_y = u r.

The unscented particle filter as published keeps a particle's covariance after it was drawn from it, so the
next proposal is far too wide and few particles keep a weight. `carry=False` draws from the process noise
alone (UPF*, ARUPF* in the tables of the benchmark).
"""
