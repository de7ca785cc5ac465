"""What tests of several modules share: small inputs, and where things are."""
