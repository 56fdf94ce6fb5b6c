"""What comes back, whether it is an answer, and how it shows itself."""
