"""Tables: a replayed drive as a table that other tools open, and users' own tables as drives.

In: the steps of a replay; CSV, Parquet, MF4 and MATLAB v7.3 files with a map. Out: the tick table as arrays,
CSV, Parquet and MCAP; frames and sentences that replay like a recording.
"""
