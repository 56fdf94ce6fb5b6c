"""What the belt does part by part, as rows of data."""
