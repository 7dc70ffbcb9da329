"""Which drive would tell effects apart: manoeuvres chosen by what the diagnosis would learn from them."""
