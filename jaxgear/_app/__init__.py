"""The room that sees everything: scene file, commands, pictures and the results folder."""
