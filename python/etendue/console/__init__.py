"""The web pages: the console of a render farm, and the viewer of one scene (`etendue view`).

`etendue.console.app.create_app` makes the console over a farm's service, `etendue.console.viewer.create_app` the viewer.
Both need `pip install "etendue[console]"`.
"""
