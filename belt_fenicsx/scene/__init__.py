"""What is asked: plain data, validated as they are made. Pure Python."""
