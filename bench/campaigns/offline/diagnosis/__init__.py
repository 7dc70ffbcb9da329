"""The proof of the diagnosis: drives of other worlds, sealed truth, and the scorer that joins the two."""
