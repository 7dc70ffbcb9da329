"""GNSS solutions: from NMEA 0183, UBX, gpsd or frames on the bus, live or from a log."""
