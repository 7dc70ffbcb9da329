"""Where drives come from: a course, the instruments of a car on it, and ticks or a drive folder.

Nothing here knows the program that is judged; of `tpmsd` only plain records are imported.
"""
