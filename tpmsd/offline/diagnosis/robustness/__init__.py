"""What was found against other noise, and how sure it is."""
