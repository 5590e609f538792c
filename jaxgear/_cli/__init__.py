"""The command line: joins scenes, studies and pictures with the folder of results."""
