"""Selection of the terms that the drives demand: stepwise, each paying for its freedom."""
