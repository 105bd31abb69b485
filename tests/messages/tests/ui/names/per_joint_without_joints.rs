use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link upper { mass: 1 kg; }
        joint flange: fixed { base -> upper; }
        per joint { input torque: N*m; force = torque; }
    }
}

fn main() {}
