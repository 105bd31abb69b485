use pid_runtime::robot;

robot! {
    pub robot Arm from urdf arm.urdf { }
}

fn main() {}
