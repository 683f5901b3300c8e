# Records every servo period: commands of joints, of axes, residual, machine on, world mode, number of refused calls.
set joints $::KINS(JOINTS)
set letters [string tolower $::TRAJ(COORDINATES)]
set n [expr {2 * $joints}]
loadrt sampler depth=8000 cfg=[string repeat f [expr {$n + 1}]]bbu
addf sampler.0 servo-thread
for {set i 0} {$i < $joints} {incr i} {
    net command-$i => sampler.0.pin.$i
    net axis-$i axis.[string index $letters $i].pos-cmd => sampler.0.pin.[expr {$joints + $i}]
}
net residual gantrytaukins.residual => sampler.0.pin.$n
net drives-on => sampler.0.pin.[expr {$n + 1}]
net world motion.coord-mode => sampler.0.pin.[expr {$n + 2}]
net refused gantrytaukins.refused => sampler.0.pin.[expr {$n + 3}]
loadusr halsampler -t record.txt
