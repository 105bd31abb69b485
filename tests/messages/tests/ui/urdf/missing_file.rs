use pid_runtime::robot;

robot! {
    pub robot Arm from urdf "nowhere.urdf" { }
}

fn main() {}
