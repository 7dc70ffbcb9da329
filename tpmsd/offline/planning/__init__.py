"""Choice of the manoeuvres that tell effects apart, by the information that the diagnosis would gain from
them."""
