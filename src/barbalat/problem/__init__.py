"""What is to be solved: plant, known set, actuation, measurement, and the tracking problems made of them."""
