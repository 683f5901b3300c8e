# Records every servo period in two samplers (20 columns each), rows of one period having one number: of each joint the command, the reference
# and their difference times 1e12, for more digits; of each joint the drive's position, and the offset times 1e6; then
# the feedback of joint 0, phase, cause, missed, tick, enable, permit, held.
set joints $::KINS(JOINTS)
set floats [expr {2 * $joints + 1}]
loadrt sampler depth=6000,6000 cfg=[string repeat f [expr {3 * $joints}]],[string repeat f $floats]ssuubbu
loadrt sum2 count=$joints
loadrt scale count=[expr {2 * $joints}]
for {set i 0} {$i < $joints} {incr i} {
    addf sum2.$i servo-thread
    set more [expr {$joints + $i}]
    addf scale.$i servo-thread
    addf scale.$more servo-thread
    setp scale.$more.gain 1e6
    setp sum2.$i.gain1 -1
    setp scale.$i.gain 1e12
    net command-$i => sum2.$i.in1 sampler.0.pin.[expr {3 * $i}]
    net reference-$i => sum2.$i.in0 sampler.0.pin.[expr {3 * $i + 1}]
    net difference-$i sum2.$i.out => scale.$i.in
    net scaled-$i scale.$i.out => sampler.0.pin.[expr {3 * $i + 2}]
    net position-$i => sampler.1.pin.[expr {2 * $i}]
    net offset-$i gantry-tau.$i.offset => scale.$more.in
    net scaled-offset-$i scale.$more.out => sampler.1.pin.[expr {2 * $i + 1}]
}
net feedback-0 => sampler.1.pin.[expr {2 * $joints}]
set at $floats
foreach name {phase cause missed tick enable permit held} {
    switch $name {
        enable { net drives-on => sampler.1.pin.$at }
        permit { net permit => sampler.1.pin.$at }
        default { net $name gantry-tau.$name => sampler.1.pin.$at }
    }
    incr at
}
addf sampler.0 servo-thread
addf sampler.1 servo-thread
loadusr halsampler -t -c 0 record-0.txt
loadusr halsampler -t -c 1 record-1.txt
