"""Reports of replays and diagnoses, for people and programs.

In: the ticks, estimates and reports of a run (`ReplayRecorder`). Out: the JSON document of `replay --json`
(`replay_document`), a summary in sentences (`replay_summary`) and a picture (`plot_replay`, optional extra).
"""
