"""Choice of the manoeuvres that distinguish effects, by the information that the diagnosis would gain from
them."""
