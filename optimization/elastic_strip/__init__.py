"""A motion deformed until its contacts lie in given regions."""
