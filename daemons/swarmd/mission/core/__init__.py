"""What the mission daemon decides: pure, time is an argument. No io of any kind may live here."""
