"""The drives that are examined, their columns and their noise."""
