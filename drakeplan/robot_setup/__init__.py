"""A stranger's robot model becomes a robot file: feet, palms, posture and reaches are found, and every guess is said."""
