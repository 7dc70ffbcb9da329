"""Which terms the drives demand: stepwise, each paying for its freedom."""
