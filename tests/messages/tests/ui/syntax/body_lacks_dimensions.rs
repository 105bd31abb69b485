use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link upper { inertial: solid cylinder { radius: 10 mm; axis: z; }  }
        link fore { mass: 1 kg; com: [0, 0, 0.1] m; }
        joint shoulder: revolute about y { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, 0.4] m; }
        per joint { input torque: N*m; force = torque; }
        emit { dynamics }
    }
}

fn main() {}
