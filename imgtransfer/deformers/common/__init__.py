"""What several methods are made of: the body's motion as features, frame rates, windows of clips, virtual bones."""
