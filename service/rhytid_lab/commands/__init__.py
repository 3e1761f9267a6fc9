"""Commands of `rhytid` that show and measure, found through the entry points `rhytid.commands`."""
