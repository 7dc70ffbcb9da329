"""The proof: concealed effects sealed, diagnosed, opened and scored, beside two other methods."""
