"""The live page: the target follows the mouse, the best posture follows the target.

::

    explorer.py ── Explorer     the handle: page, target, answer
    answers.py ─── Answers      the loop of solving: one thread, the newest request wins
    other_process.py            the full search and maps, in a process of its own that can be stopped
    live_scene.py  LiveScene    the arm, its error region, obstacles and the narrowest gap on the page
    panel.py ───── Panel        numbers and joints; task_panel.py, obstacles_panel.py what may be asked differently
    stations.py    Stations     features and paths: chosen, played back, their workpiece dragged
    live_map.py    LiveMap      the spread over the bench
    measured.py    Measured     measurements with their errors, causes switched on and off
    taken_away.py  TakenAway    what is written: problem, report, picture; and the command line
    server.py ──── a viser server behind a gate

A thin client of the public interface: nothing here has a formula of its own. viser is an optional extra.
"""
