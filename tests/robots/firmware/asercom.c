/* What GCtronic's Asercom.c needs below it, for selector 10: a Linux board is on UART 2.
 *
 * Functions of cameras, sound and the like that it never calls are added when it is linked. */
#include "motor_led/e_epuck_ports.h"

#include "leds_on.h"
#include "memory.h"
#include "page.h"

char buffer[BUFFER_SIZE];
char c;
int selector;
int e_mic_scan[3][100], e_ambient_ir[10], e_ambient_and_reflected_ir[10];
unsigned int e_last_mic_scan_id;

int run_asercom(void);
void e_start_agendas_processing(void);
void _T2Interrupt(void);
int e_get_steps_left(void);
int e_get_steps_right(void);

/* As main_c.c begins with this selector. */
int firmware_main(void)
{
    e_start_agendas_processing();
    uart_flush();
    return run_asercom();
}

int getselector(void) { return 10; }

/* In place of all three batteries of its revisions: the pin. */
int isEpuckVersion1_3(void)
{
    BATT_LOW = page->battery_good;
    return 0;
}

int e_getchar_uart2(char *byte) { return uart_get(byte); }
void e_send_uart2_char(const char *bytes, int length) { uart_put(bytes, length); }

/* Sensors 8 and 9 are the robot's free inputs of the converter. */
void chip_tick(void)
{
    for (int i = 0; i < 8; i++) {
        e_ambient_ir[i] = page->light[i];
        e_ambient_and_reflected_ir[i] = page->light[i] - page->proximity[i];
    }
    if (IEC0bits.T2IE && T2CONbits.TON)
        _T2Interrupt();
}

void chip_shows(struct page *shown)
{
    shown->left_steps = e_get_steps_left();
    shown->right_steps = e_get_steps_right();
    shown->leds = leds_on();
}
