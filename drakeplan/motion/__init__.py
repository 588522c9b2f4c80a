"""From a contact sequence to momenta, forces and a whole-body motion."""
