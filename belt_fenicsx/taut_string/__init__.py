"""The taut string, in closed form: first guess and limit of the other methods."""
