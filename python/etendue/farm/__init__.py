"""The rendering farm: scenes as packages, jobs as units, units on Ray, films merged exactly.

`etendue farm …` is the command line (`cli`), `service.Farm` what it and the console call, `scheduler` what does the work. Needs
`pip install "etendue[farm]"`.
"""
