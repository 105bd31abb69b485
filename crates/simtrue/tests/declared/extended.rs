simtrue::robot! { pub robot WristExtended { gravity: [0,0,0] m/s^2; link a { mass: 1 kg; } joint b: prismatic along x { base -> a; } per joint { input u: N; force = u; } } }
