"""Events in, fixed-rate `tick.Tick`s out: one clock, one local plane, one merge of both streams."""
