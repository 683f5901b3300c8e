# Pins of panel.xml, once LinuxCNC's screen has made them.

loadrt select8
addf select8.0 servo-thread
net phase gantry-tau.phase => select8.0.sel
for {set phase 0} {$phase < 6} {incr phase} { net phase-$phase select8.0.out$phase => pyvcp.phase.legend$phase }

net rearm pyvcp.rearm
net stop pyvcp.stop
net missed gantry-tau.missed => pyvcp.missed
for {set cart 0} {$cart < 3} {incr cart} { net offset-$cart gantry-tau.$cart.offset => pyvcp.offset-$cart }

# The simulated force sensor under a force in x of the world: [sensor] of robots/l2.toml and f1.toml with the platform unturned. At a machine
# the driver of the sensor is connected to these signals instead.
loadrt scale count=2
foreach {place gain signal} {0 -1 wrench-1 1 0.08 wrench-3} {
    addf scale.$place servo-thread
    setp scale.$place.gain $gain
    net force pyvcp.force-f => scale.$place.in
    net $signal scale.$place.out
}
