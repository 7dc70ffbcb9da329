"""The filters of [Lundquist 2013]: their representations, motion and radius models, likelihoods."""
